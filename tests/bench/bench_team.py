"""A daemon with three mates: from an assignment to the new setpoint, and its share of a core.

    python -m tests.bench.bench_team [--seconds 30]

`guidance run` flies a mock PX4 in a process of its own; all talk over Zenoh on loopback. This process is the three
mates: each sends its state and two evaders ten times a second, and the first one is the coordinator. It assigns the
other evader at random times. The latency is the time from the call that sends an assignment to the arrival of the first
setpoint against that evader at the vehicle's side. The daemon's record tells which setpoint that is.
"""

import argparse
import json
import math
import random
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path

import tomlkit
from pymavlink.dialects.v20 import common as mavlink

from guidance.frames import Amsl, LocalFrame, Ned
from guidance.links.mavlink.frames import Station
from guidance.links.wires.base import TO_VEHICLE
from guidance.links.wires.udp import UdpWire
from guidance.links.zenoh.session import open_session
from guidance.links.zenoh.team import ZenohTeam
from guidance.log.entries import CYCLE
from guidance.log.reader import scan
from guidance.session.orders.control_bus import free_endpoint
from guidance.session.orders.control_client import join_session
from guidance.session.orders.control_token import token_path
from guidance.team.messages import (
    EvaderMessage,
    RolesMessage,
    StateMessage,
    TeamMessage,
    VehicleRole,
    read_message,
    write_message,
)
from sitl_mock.child import RunningFleet, free_udp_port, running
from sitl_mock.world import DEFAULT_HOME
from tests.acceptance.relay import wait
from tests.bench.bench_links import SETPOINT, processor_s
from tests.harness.bus import ask
from tests.harness.vehicle import FENCED, document, mocked

GUIDANCE = Path(sys.executable).parent / "guidance"
NAME = "uav1"
MATES = ("uav0", "uav2", "uav3")
ROVERS = {"rover1": (0.0, 60.0), "rover2": (0.0, -60.0)}
"""Places of the evaders, north and east of home, m. They stand still, and are never reached."""

EVERY_S = 0.1
WITHIN_S = 60.0
FRAME = LocalFrame(*DEFAULT_HOME[:2], Amsl(DEFAULT_HOME[2]))


class Mates:
    """Three mates and two evaders; `assign` chooses the daemon's evader."""

    def __init__(self, endpoint: str, ports: dict[str, int], stack: ExitStack) -> None:
        self.sent: list[tuple[float, str]] = []
        self.heard: TeamMessage | None = None
        self._evader = "rover1"
        self._seq = 0
        self._term = 1
        self._ends = {}
        for name in MATES:
            session = stack.enter_context(join_session(endpoint))
            end = ZenohTeam(time.monotonic, session, "north", name, (NAME, *MATES))
            self._ends[name] = stack.enter_context(closing(end))
        self._rovers: list[tuple[Station, tuple[float, float]]] = []
        for number, (name, port) in enumerate(ports.items(), start=2):
            wire = stack.enter_context(closing(UdpWire(time.monotonic, "127.0.0.1", port)))
            self._rovers.append((Station(wire, number, 1), ROVERS[name]))
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        stack.callback(self._end)

    def assign(self, evader: str) -> None:
        """Assign another evader, and note when."""
        with self._lock:
            self._evader = evader
            self.sent.append((time.monotonic(), evader))
            self._tell_roles()

    def _run(self) -> None:
        while not self._ended.wait(EVERY_S):
            for _, key, payload in self._ends["uav0"].receive():
                message = read_message(key.partition("/")[0], payload)
                if isinstance(message, StateMessage) and message.vehicle == NAME:
                    self.heard = message
            with self._lock:
                self._tell_all()
                self._tell_roles()

    def _tell_roles(self) -> None:
        self._seq += 1
        role = VehicleRole(vehicle=NAME, evader=self._evader, above_m=0.0)
        made = RolesMessage(vehicle="uav0", epoch=1, seq=self._seq, term=self._term, roles=(role,))
        self._ends["uav0"].publish(made.key, write_message(made))

    def _tell_all(self) -> None:
        """Send the states and reports of a tenth of a second."""
        self._seq += 1
        now_s = time.monotonic()
        for number, (name, end) in enumerate(self._ends.items()):
            common = {"vehicle": name, "epoch": 1, "seq": self._seq, "sent_s": now_s}
            state = StateMessage(
                **common, **placed(40.0, 20.0 * number - 20.0, 20.0), velocity_ned_m_s=(0.0, 0.0, 0.0), state="engaged",
                part="playing", airborne=True, speed_m_s=6.0, climb_m_s=2.0, descent_m_s=1.5, term=self._term,
            )  # fmt: skip
            end.publish(state.key, write_message(state))
            for evader, position in ROVERS.items():
                message = EvaderMessage(
                    **common, **placed(*position, 0.0), evader=evader, source="GLOBAL_POSITION_INT"
                )
                end.publish(message.key, write_message(message))
        for station, position in self._rovers:
            at = placed(*position, 0.0)
            fields = [
                round(at[key] * scale)
                for key, scale in (
                    ("latitude_deg", 1e7),
                    ("longitude_deg", 1e7),
                    ("altitude_amsl_m", 1e3),
                )
            ]
            station.send(
                mavlink.MAVLink_global_position_int_message(
                    round(now_s * 1e3) % 2**32, *fields, 0, 0, 0, 0, 0
                )
            )

    def _end(self) -> None:
        self._ended.set()
        self._thread.join()


def placed(north_m: float, east_m: float, up_m: float) -> dict[str, float]:
    """Return a place as messages have it."""
    latitude, longitude, altitude = FRAME.wgs84_from_ned(Ned((north_m, east_m, -up_m)))
    return {
        "latitude_deg": latitude,
        "longitude_deg": longitude,
        "altitude_amsl_m": altitude.metres,
    }


def vehicle_file(folder: Path, fleet: RunningFleet, endpoint: str, ports: dict[str, int]) -> Path:
    """Write the daemon's file."""
    evaders = {
        name: {"kind": "global_position", "url": f"udpin://127.0.0.1:{port}", "system_id": number}
        for number, (name, port) in enumerate(ports.items(), start=2)
    }
    path = folder / f"{NAME}.toml"
    written = document(
        vehicle={"url": f"zenoh://{fleet[NAME].zenoh.removeprefix('tcp/')}/{NAME}"},
        evader=evaders["rover1"],
        flight={"on_terminate": "land"},
        control={"endpoint": endpoint},
        record={"folder": str(folder)},
        team={
            "name": "north",
            "mates": list(MATES),
            "evader": "rover1",
            "evaders": {"rover2": evaders["rover2"] | {"speed_m_s": 3.0}},
        },
    )
    path.write_text(tomlkit.dumps(written), encoding="utf-8")
    return path


def latencies_s(
    record: Path, sent: Sequence[tuple[float, str]], arrived_s: dict[bytes, float]
) -> list[float]:
    """Return the time from each assignment to the arrival of the first setpoint against its evader."""
    changed = None
    firsts = []
    for item in scan(record):
        if item.topic == CYCLE.topic:
            changed = (json.loads(item.data)["inputs"].get("role") or {}).get("evader")
        elif changed and item.topic == f"{NAME}/{TO_VEHICLE}" and item.data in arrived_s:
            firsts.append((arrived_s[item.data], changed))
            changed = None
    waits = []
    for at_s, evader in sent:
        first = next(
            (there_s for there_s, name in firsts if name == evader and there_s > at_s), math.inf
        )
        waits.append(first - at_s)
    return sorted(waits)


def measure(seconds: float, folder: Path) -> None:
    """Fly, and print both figures."""
    arrived_s: dict[bytes, float] = {}
    with ExitStack() as stack:
        fleet = stack.enter_context(running([mocked(NAME, parameters=FENCED)], over=["zenoh"]))
        endpoint = free_endpoint()
        ports = {name: free_udp_port({"uav1": "px4"}) for name in ROVERS}
        command = [str(GUIDANCE), "run", str(vehicle_file(folder, fleet, endpoint, ports))]
        daemon = stack.enter_context(subprocess.Popen(command))
        stack.callback(daemon.terminate)
        listener = stack.enter_context(open_session(fleet[NAME].zenoh))
        listener.declare_subscriber(
            f"{NAME}/{TO_VEHICLE}",
            lambda sample: arrived_s.setdefault(sample.payload.to_bytes(), time.monotonic()),
        )
        if not wait(token_path(endpoint).exists, WITHIN_S):
            sys.exit("the daemon did not start")
        mates = Mates(endpoint, ports, stack)

        def state_is(words: str) -> bool:
            return isinstance(mates.heard, StateMessage) and mates.heard.state == words

        def accepted(order: str) -> bool:
            return bool(ask(order, endpoint=endpoint, name=NAME)["accepted"])

        for order, state in (("start", "standing by"), ("engage", "engaged")):
            if not (
                wait(lambda order=order: accepted(order), WITHIN_S)
                and wait(lambda state=state: state_is(state), WITHIN_S)
            ):
                sys.exit(f"{order} was not followed: {mates.heard and mates.heard.state}")
        chance = random.Random(1)
        until_s = time.monotonic() + seconds
        began_s = time.monotonic()
        spent_s = processor_s(daemon.pid)
        while time.monotonic() < until_s:
            for evader in ("rover2", "rover1"):
                mates.assign(evader)
                time.sleep(chance.uniform(0.3, 0.6))
        share = (processor_s(daemon.pid) - spent_s) / (time.monotonic() - began_s)
    (record,) = folder.glob("*.mcap")
    waits = latencies_s(record, mates.sent, arrived_s)
    frames = sum(int.from_bytes(frame[7:10], "little") == SETPOINT for frame in arrived_s)
    middle = waits[len(waits) // 2]
    late = waits[math.ceil(0.99 * len(waits)) - 1]
    counted = f"{len(waits)} assignments, {frames} setpoints"
    print(
        f"assignment to new setpoint: p50 {middle * 1e3:.0f} ms, p99 {late * 1e3:.0f} ms ({counted})"
    )
    print(f"daemon with three mates: {100.0 * share:.0f} % of a core")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=30.0, help="of the game (default 30)")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        measure(arguments.seconds, Path(folder))


if __name__ == "__main__":
    main()
