"""Own code beside the libraries that could replace it: processor time of each on the same data, best of 5.

    python -m tests.bench.bench_libraries

`pip install msgspec antimeridian` adds those that the project does not use. The record is of a flight in virtual time
that this program makes; a library has to cost less than a tenth of that flight's processor time more.
"""

import contextlib
import io
import json
import random
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import Writer
from pymavlink.DFReader import DFReader_binary
from pyulog import ULog

from guidance.log import date_line
from guidance.log.entries import CYCLE
from guidance.session.orders.replies import is_bad, read_reply
from sitl_mock.logs import dataflash, ulog
from tests.harness.flights import NEAR, flown
from tests.sitl_mock.logs.test_flight_logs import ARM, SET_MODE, Flight

CLIMB = ("SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 1, 2503, *(0.0,) * 5, -2.0, *(0.0,) * 5)
POSITION = "vehicle_local_position"
DAMAGED = 60
"""Copies of a log, each with 20 wrong bytes."""


def best_ms(work):
    spent = []
    for _ in range(5):
        started = time.process_time()
        work()
        spent.append(time.process_time() - started)
    return min(spent) * 1e3


def compare(what, **ways):
    print(f"{what}: " + ", ".join(f"{name} {best_ms(way):.1f} ms" for name, way in ways.items()))


def records(path):
    with path.open("rb") as file:
        rows = [
            (channel.topic, message.log_time, bytes(message.data))
            for _, channel, message in make_reader(file).iter_messages()
        ]
    topics = sorted({topic for topic, _, _ in rows})

    def library():
        writer = Writer(io.BytesIO(), chunk_size=1 << 20)
        writer.start()
        numbers = {topic: writer.register_channel(topic, "json", 0) for topic in topics}
        for index, (topic, time_ns, data) in enumerate(rows):
            writer.add_message(numbers[topic], time_ns, data, time_ns, index)
        writer.finish()

    compare(f"{len(rows)} messages of a record", mcap=library)
    return [data for topic, _, data in rows if topic == CYCLE.topic]


def texts(cycles):
    values = [CYCLE.decode(data) for data in cycles]
    status = {"accepted": True, "state": "ENGAGED", "reasons": ["a reason to wait"] * 100}
    reply = json.dumps(status).encode()
    hostile = {
        "20 lists deep": b'{"a":' + b"[" * 20 + b"]" * 20 + b"}",
        "the integer 2**60": b'{"a":1152921504606846976}',
        "a list of 5000": b'{"a":[' + b"1," * 4999 + b"1]}",
    }
    own = {
        "own": lambda: [CYCLE.encode(value) for value in values],
        "own_decode": lambda: [CYCLE.decode(data) for data in cycles],
    }
    if find_spec("msgspec") is None:
        compare(f"{len(cycles)} cycles", **own)
        return
    import msgspec

    plain = [json.loads(data) for data in cycles]
    decode = msgspec.json.decode
    own["msgspec_of_dictionaries"] = lambda: [msgspec.json.encode(value) for value in plain]
    own["msgspec_decode_to_dictionaries"] = lambda: [decode(data) for data in cycles]
    compare(f"{len(cycles)} cycles", **own)
    try:
        msgspec.json.Decoder(type(values[0]))
    except TypeError as error:
        print(f"  msgspec does not read a cycle: {error}")
    compare(
        "1000 replies",
        own=lambda: [read_reply(reply, "uav1", "status") for _ in range(1000)],
        msgspec=lambda: [decode(reply) for _ in range(1000)],
    )
    for name, data in hostile.items():
        assert is_bad(read_reply(data, "uav1", "status"))
        decode(data)
        print(f"  {name}: own refuses it, msgspec takes it")


def maps():
    ring = [(179.9, 10, 5), (-179.9, 10, 6), (-179.9, 11, 7), (179.9, 11, 8), (179.9, 10, 5)]
    print(f"a ring across the date line: own has {len(date_line.cut_ring(ring))} pieces")
    if find_spec("antimeridian") is not None:
        import antimeridian

        try:
            antimeridian.fix_geojson({"type": "Polygon", "coordinates": [ring]})
        except ValueError as error:
            print(f"  antimeridian refuses altitudes: {error}")


def logged(flavour, guided):
    flight = Flight(flavour, noise=False)
    for index in range(1500):
        flight.step(CLIMB)
        if index == 100:
            flight.command(SET_MODE, 1, guided)
            flight.command(ARM, 1)
    return flight.vehicle.logs[0].content


def rows_of_pyulog(content):
    topics = [one for one in ULog(io.BytesIO(content)).data_list if one.name == POSITION]
    return topics[0].data["vx"]


def rows_of_dfreader(content):
    with tempfile.NamedTemporaryFile() as file:
        file.write(content)
        file.flush()
        log = DFReader_binary(file.name, zero_time_base=False)
        rows = []
        while (message := log.recv_match(type="XKF1")) is not None:
            rows.append(message.VN)
        log.close()
    return rows


def logs():
    ours = {
        "px4": lambda content: ulog.read(content, {POSITION: ("vx",)}, "log")[POSITION],
        "arducopter": lambda content: dataflash.read(content, {"XKF1": ("VN",)}, "log")["XKF1"],
    }
    theirs = {"px4": ("pyulog", rows_of_pyulog), "arducopter": ("pymavlink", rows_of_dfreader)}
    for flavour, guided in (("px4", 6), ("arducopter", 4)):
        content = bytes(logged(flavour, guided))
        own = ours[flavour]
        name, library = theirs[flavour]
        assert len(own(content)) == len(library(content))
        compare(
            f"a log of {flavour} of {len(content)} bytes",
            own=lambda: own(content),  # noqa: B023 - called at once
            **{name: lambda: library(content)},  # noqa: B023 - called at once
        )
        for who, read in (("own", own), (name, library)):
            draw = random.Random(1)
            usable = 0
            for _ in range(DAMAGED):
                damaged = bytearray(content)
                for _ in range(20):
                    damaged[draw.randrange(len(damaged))] = draw.randrange(256)
                quiet = io.StringIO()
                with contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
                    try:
                        usable += len(read(bytes(damaged))) > 0
                    except Exception:
                        continue
            print(f"  {who}: rows of {usable} of {DAMAGED} damaged logs")


def main():
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.mcap"
        started = time.process_time()
        flown(NEAR, path)
        print(f"the flight: {(time.process_time() - started) * 1e3:.0f} ms")
        texts(records(path))
    maps()
    logs()


if __name__ == "__main__":
    main()
