"""Speed of the mock: stepped in process, in real time, to the first HEARTBEAT, and memory; one line a figure.

    python tests/bench/bench_mock.py [--quick]

The stepped figures count full MAVLink 2 bytes both ways at PX4's onboard rates, setpoints at 50 Hz, on one core, and
are per second of processor time, so that a busy machine does not hide them; everything else is by the clock on the
wall and wants a quiet machine.
"""

import argparse
import contextlib
import gc
import json
import math
import socket
import statistics
import subprocess
import sys
import time
import tracemalloc

from sitl_mock import MockVehicle
from sitl_mock.mavlink import Decoder, Encoder

STEP_S = 0.02
FLYING_TICK = 501
TARGET = 300.0


def say(name, value, note=""):
    print(f"{name:<58} {value:>14}  {note}", flush=True)


def setpoint(encoder, now_s):
    return encoder.pack(
        "SET_POSITION_TARGET_LOCAL_NED", int(now_s * 1000), 1, 1, 1, 2503,
        0, 0, 0, 2.0 * math.sin(0.3 * now_s), 1.0, -0.2, 0, 0, 0, 0.0, 0.0,
    )  # fmt: skip


def flying(flavour, **settings):
    """A vehicle in the air that follows a stream, and its client; the clock stands at FLYING_TICK."""
    vehicle = MockVehicle(flavour, ready_after_s=0.5, **settings)
    encoder = Encoder(1, 195)
    mode = {"px4": (1.0, 6.0), "arducopter": (1.0, 4.0), "rover": (1.0, 15.0)}[flavour]
    commands = {50: (176, *mode), 55: (400, 1.0, 0.0), 60: (22, 0, 0, 0, 0, 0, 0, 10.0)}
    if flavour != "px4":
        for number, (message_id, hertz) in enumerate(
            ((30, 100), (31, 50), (33, 50), (32, 50), (331, 30), (105, 50))
        ):
            commands[10 + number] = (511, float(message_id), 1e6 / hertz)
    else:
        del commands[60]
    for tick in range(FLYING_TICK):
        now_s = tick * STEP_S
        # A setpoint would end the take-off
        taking_off = flavour == "arducopter" and 60 <= tick < 400
        frames = [] if taking_off else [setpoint(encoder, now_s)]
        if tick in commands:
            params = [*commands[tick], *[0.0] * (8 - len(commands[tick]))]
            frames.append(encoder.pack("COMMAND_LONG", 1, 1, params[0], 0, *params[1:]))
        vehicle.step(now_s, frames)
    assert vehicle.armed, flavour
    assert flavour == "rover" or not vehicle.truth.on_ground, flavour
    return vehicle, encoder


def stepped(flavour, seconds, rounds):
    """Vehicle-seconds per second, best of some rounds, and messages per simulated second."""
    vehicle, encoder = flying(flavour)
    gc.collect()
    gc.freeze()
    rates = []
    tick = FLYING_TICK
    messages = 0
    for _ in range(rounds):
        begun = time.process_time()
        messages = 0
        for _ in range(round(seconds / STEP_S)):
            now_s = tick * STEP_S
            messages += len(vehicle.step(now_s, [setpoint(encoder, now_s)]))
            tick += 1
        rates.append(seconds / (time.process_time() - begun))
    return max(rates), statistics.median(rates), messages / seconds


def memory(count):
    """Kilobytes that Python allocates for one more vehicle."""
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    vehicles = [MockVehicle("px4", system_id=1 + index % 255) for index in range(count)]
    for vehicle in vehicles:
        vehicle.step(0.0)
        vehicle.step(1.0)
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return (after - before) / 1024.0 / count


def first_heartbeat(rounds):
    """Seconds from the start of the process, and of the interpreter alone, to the first HEARTBEAT by UDP."""
    whole = []
    bare = []
    for _ in range(rounds):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.bind(("127.0.0.1", 0))
            client.settimeout(10.0)
            port = client.getsockname()[1]
            begun = time.perf_counter()
            child = _child("--vehicles", "1", "--udp", str(port))
            decoder = Decoder()
            while not any(
                m.get_type() == "HEARTBEAT" for m in decoder.feed(client.recv(2048), whole=True)
            ):
                pass
            whole.append(time.perf_counter() - begun)
            _end(child)
        begun = time.perf_counter()
        subprocess.run([sys.executable, "-c", "pass"], check=True)
        bare.append(time.perf_counter() - begun)
    return statistics.median(whole), statistics.median(bare)


def _child(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "sitl_mock", "run", "--json", "--parent-pipe", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )


def _end(child):
    child.stdin.close()
    child.wait(10.0)
    child.stdout.close()


def real_time(count, seconds):
    """p50 and p99 of the lateness of ATTITUDE (100 Hz) of the first vehicle, and the process's share of one core."""
    with contextlib.ExitStack() as stack:
        client, *_ = (stack.enter_context(each) for each in _clients(count))
        client.settimeout(10.0)
        child = _child("--vehicles", str(count), "--udp", str(client.getsockname()[1]))
        json.loads(child.stdout.readline())
        decoder = Decoder()
        stamps = []
        client.recv(2048)
        used_s = _cpu_s(child.pid)
        begun = time.perf_counter()
        while time.perf_counter() - begun < seconds:
            data = client.recv(2048)
            now_s = time.perf_counter()
            heard = decoder.feed(data, whole=True)
            stamps += [
                now_s - each.time_boot_ms * 1e-3 for each in heard if each.get_type() == "ATTITUDE"
            ]
        spent_s = time.perf_counter() - begun
        share = (_cpu_s(child.pid) - used_s) / spent_s
        _end(child)
    least = min(stamps)
    late = sorted(stamp - least for stamp in stamps)
    return late[len(late) // 2], late[int(len(late) * 0.99)], share, len(stamps) / spent_s


def _clients(count):
    """A socket per vehicle on consecutive ports, because a datagram to a closed port costs an error."""
    for first in range(20_000, 60_000, 128):
        sockets = []
        try:
            for port in range(first, first + count):
                sockets.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                sockets[-1].bind(("127.0.0.1", port))
        except OSError:
            for each in sockets:
                each.close()
        else:
            return sockets
    raise SystemExit(f"no {count} free ports in a row")


def _cpu_s(pid):
    with open(f"/proc/{pid}/stat", encoding="ascii") as file:  # noqa: PTH123 - a number from the kernel
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / 100.0


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="short rounds")
    quick = parser.parse_args().quick
    seconds, rounds = (10.0, 3) if quick else (30.0, 7)
    for flavour in ("px4", "arducopter", "rover"):
        best, middle, messages = stepped(flavour, seconds, rounds)
        note = f"median {middle:.0f}, {messages:.0f} messages/s out" + (
            f", target {TARGET:.0f}" if flavour == "px4" else ""
        )
        say(f"stepped, {flavour}: vehicle-seconds per second", f"{best:.0f}", note)
    say("memory per vehicle", f"{memory(20 if quick else 60):.0f} kB")
    whole, bare = first_heartbeat(3 if quick else 7)
    say(
        "start to first HEARTBEAT",
        f"{whole - bare:.3f} s",
        f"after {bare:.3f} s for the interpreter; target 0.5 s",
    )
    for count in (1, 20) if quick else (1, 10, 20, 50, 100):
        p50, p99, share, rate = real_time(count, 5.0 if quick else 10.0)
        note = (
            f"p99 {p99 * 1e3:.1f} ms, {share * 100:.0f} % of one core, {rate:.1f} of 100 Hz arrive"
        )
        say(f"real time, {count} vehicles by UDP: send jitter p50", f"{p50 * 1e3:.1f} ms", note)


if __name__ == "__main__":
    main()
