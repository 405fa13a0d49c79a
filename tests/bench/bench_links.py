"""Telemetry in to setpoint on the wire, for every link, beside a minimal MAVSDK script, in one run.

    python tests/bench/bench_links.py [--seconds 10] [--rounds 2]

A vehicle in its own process sends what a PX4 sends on its onboard link (LOCAL_POSITION_NED at 50 Hz among 300 other
messages a second) and takes the time from each LOCAL_POSITION_NED to the first setpoint that comes back. The
other end runs in a process of its own as well: our link, polled every 0.05 ms, sends one setpoint for each position;
the script does only that with MAVSDK's Telemetry and Offboard plugins. Rounds are interleaved, and
the ratio is to the script on the same wire in the same round.
"""

import argparse
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

RATE_HZ = 50
SETPOINT = 84
WIRES = ("udp", "zenoh")
ENDS = ("script", "mavsdk", "pymavlink")
NAMESPACE = "uav1"
POLL_S = 5e-5
SETTLING_S = 2  # for imports and discovery, not measured


def open_wire(
    wire: str, port: int, on_frame: Callable[[bytes], None]
) -> tuple[Callable[[bytes], object], Callable[[], None]]:
    """The vehicle's end: (send, close)."""
    if wire == "udp":
        ours = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        ours.bind(("127.0.0.1", 0))

        def read() -> None:
            while data := ours.recv(2048):
                on_frame(data)

        threading.Thread(target=read, daemon=True).start()
        return lambda data: ours.sendto(data, ("127.0.0.1", port)), lambda: None

    import zenoh

    closed = {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
    config = {
        "mode": "router",
        "listen": {"endpoints": [f"tcp/127.0.0.1:{port}"]},
        "scouting": closed,
    }
    session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    out = session.declare_publisher(
        f"{NAMESPACE}/mavlink_raw/out",
        express=True,
        congestion_control=zenoh.CongestionControl.DROP,
    )
    session.declare_subscriber(
        f"{NAMESPACE}/mavlink_raw/in",
        lambda sample: on_frame(sample.payload.to_bytes()),
        allowed_origin=zenoh.Locality.REMOTE,
    )
    return out.put, session.close


class Stopwatch:
    """Times each position to the first setpoint after it."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        self.asked_s: float | None = None
        self.latencies: list[float] = []
        self.sent = self.missed = 0

    def on_frame(self, data: bytes) -> None:
        now_s = time.perf_counter()
        if len(data) > 9 and data[0] == 0xFD and int.from_bytes(data[7:10], "little") == SETPOINT:
            asked_s = self.asked_s
            self.asked_s = None
            if asked_s is not None:
                self.latencies.append(now_s - asked_s)

    def ask(self) -> None:
        self.missed += self.asked_s is not None
        self.sent += 1
        self.asked_s = time.perf_counter()


def background(n: int, ms: int) -> list:
    """Return other messages of a PX4: attitude at 100 Hz, its quaternion, sensors, both positions at 50 Hz."""
    from pymavlink.dialects.v20 import common as dialect

    heartbeat = (
        [dialect.MAVLink_heartbeat_message(2, 12, 157, 6 << 16, 4, 3)] if n % 100 == 0 else []
    )
    attitude = dialect.MAVLink_attitude_message(ms, 0.01, 0.02, 1.5, 0, 0, 0)
    if n % 2 == 0:
        return [*heartbeat, attitude]
    zero = [0.0] * 6
    half = [0.5] * 3
    covariance = [0.1] * 21
    return [
        attitude,
        dialect.MAVLink_attitude_quaternion_message(ms, 1, *zero),
        dialect.MAVLink_highres_imu_message(ms * 1000, *[0.5] * 13, 0),
        dialect.MAVLink_global_position_int_message(
            ms, 473977418, 85455939, 500000, 12000, 1, 2, 3, 0
        ),
        dialect.MAVLink_odometry_message(
            ms, 1, 1, *half, [1, 0, 0, 0], *zero, covariance, covariance
        ),
    ]


def vehicle(wire: str, port: int, seconds: float) -> None:
    """Send telemetry, time the answers, print the results as JSON."""
    from pymavlink.dialects.v20 import common as dialect

    mavlink = dialect.MAVLink(None, 1, 1)
    watch = Stopwatch()
    send, close = open_wire(wire, port, watch.on_frame)

    def packed(message: object) -> bytes:
        mavlink.seq = (mavlink.seq + 1) % 256
        return bytes(message.pack(mavlink))

    print("ready", flush=True)
    start_s = time.perf_counter()
    for n in range(round(2 * RATE_HZ * (SETTLING_S + seconds))):
        due_s = start_s + n / (2 * RATE_HZ)
        while (left_s := due_s - time.perf_counter()) > 0:
            time.sleep(left_s)
        ms = round((due_s - start_s) * 1e3)
        for message in background(n, ms):
            send(packed(message))
        if n == 2 * RATE_HZ * SETTLING_S:
            watch.restart()
            print("measuring", flush=True)
        if n % 2 == 0:
            position = packed(
                dialect.MAVLink_local_position_ned_message(ms, 1.0, 2.0, -20.0, 0.1, 0.2, 0.3)
            )
            watch.ask()
            send(position)
    print(
        json.dumps({"sent": watch.sent, "missed": watch.missed, "latencies": watch.latencies}),
        flush=True,
    )
    close()


def url_of(wire: str, port: int) -> str:
    return f"udpin://127.0.0.1:{port}" if wire == "udp" else f"zenoh://127.0.0.1:{port}/{NAMESPACE}"


def our_end(kind: str, wire: str, port: int) -> None:
    """One setpoint for each position, found by polling, until standard input closes."""
    from guidance.frames import Ned
    from guidance.links.opening import open_link, open_wire
    from guidance.messages import LocalPosition, Setpoint

    over = until_closed()
    url = url_of(wire, port)
    now = time.monotonic
    link = open_link(open_wire(url, clock=now, systems=(1,)), kind, system_id=1, clock=now, who=url)
    setpoint = Setpoint(Ned((1.0, 0.0, 0.0)), yaw_rad=0.0)
    while not over.is_set():
        time.sleep(POLL_S)
        for message in link.receive():
            if isinstance(message, LocalPosition):
                link.send_setpoint(setpoint)
    link.close()


def script_end(wire: str, port: int) -> None:
    """The smallest MAVSDK program that answers each position with a velocity."""
    from mavsdk import ComponentType, Configuration, Mavsdk
    from mavsdk.logging import log_subscribe
    from mavsdk.plugins.offboard import Offboard, VelocityNedYaw
    from mavsdk.plugins.telemetry import Telemetry

    over = until_closed()
    log_subscribe(lambda *_: True)
    with Mavsdk(
        Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)
    ) as mavsdk:
        close = bridge(mavsdk, port) if wire == "zenoh" else (lambda: None)
        mavsdk.add_any_connection("raw://" if wire == "zenoh" else f"udpin://127.0.0.1:{port}")
        system = mavsdk.first_autopilot(10.0)
        telemetry = Telemetry(system)
        offboard = Offboard(system)
        velocity = VelocityNedYaw(1.0, 0.0, 0.0, 0.0)
        telemetry.set_rate_position_velocity_ned_async(float(RATE_HZ), lambda *_: None)
        telemetry.subscribe_position_velocity_ned(lambda *_: offboard.set_velocity_ned(velocity))
        over.wait()
        close()


def bridge(mavsdk: object, port: int) -> Callable[[], None]:
    """Connect MAVSDK to Zenoh through its raw connection."""
    import zenoh

    closed = {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
    config = {
        "mode": "client",
        "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"]},
        "scouting": closed,
    }
    session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    into = session.declare_publisher(
        f"{NAMESPACE}/mavlink_raw/in", express=True, congestion_control=zenoh.CongestionControl.DROP
    )
    open_ = threading.Event()
    open_.set()
    mavsdk.subscribe_raw_bytes_to_be_sent(lambda data: into.put(data) if open_.is_set() else None)
    out = session.declare_subscriber(
        f"{NAMESPACE}/mavlink_raw/out",
        lambda sample: mavsdk.pass_received_raw_bytes(sample.payload.to_bytes()),
        allowed_origin=zenoh.Locality.REMOTE,
    )

    def close() -> None:
        open_.clear()
        out.undeclare()
        time.sleep(0.2)  # late Zenoh samples must not reach a destroyed MAVSDK
        session.close()

    return close


def until_closed() -> threading.Event:
    """Set when the parent closes our standard input (or dies)."""
    ended = threading.Event()

    def watch() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=watch, daemon=True).start()
    return ended


def one_case(end: str, wire: str, seconds: float) -> dict[str, float]:
    """Run a vehicle and an end; return the vehicle's latencies and the processor time of the end."""
    kind = socket.SOCK_DGRAM if wire == "udp" else socket.SOCK_STREAM
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    own = [sys.executable, __file__]
    measure = [*own, "--as-vehicle", wire, "--port", str(port), "--seconds", str(seconds)]
    with subprocess.Popen(measure, stdout=subprocess.PIPE, text=True) as flying:
        assert flying.stdout is not None
        flying.stdout.readline()
        answer = [*own, "--as-end", end, wire, "--port", str(port)]
        with subprocess.Popen(answer, stdin=subprocess.PIPE) as answering:
            flying.stdout.readline()
            before_s = processor_s(answering.pid)
            result = json.loads(flying.stdout.readline())
            used_s = processor_s(answering.pid) - before_s
            assert answering.stdin is not None
            answering.stdin.close()
            answering.wait(15.0)
    times = sorted(result["latencies"])
    return {
        "p50_us": median(times) * 1e6,
        "p99_us": times[int(0.99 * (len(times) - 1))] * 1e6,
        "missed": result["missed"],
        "sent": result["sent"],
        "cpu_percent": 100.0 * used_s / seconds,
    }


def processor_s(pid: int) -> float:
    """User and system time of a process so far, in seconds (Linux)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def compare(seconds: float, rounds: int) -> None:
    print("wire   end        round   p50 us   p99 us  x p50  x p99  missed  cpu %")
    table: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for number in range(1, rounds + 1):
        for wire in WIRES:
            base = None
            for end in ENDS:
                got = one_case(end, wire, seconds)
                base = base or got
                ratios = got["p50_us"] / base["p50_us"], got["p99_us"] / base["p99_us"]
                table.setdefault((wire, end), []).append(ratios)
                print(
                    f"{wire:6} {end:10} {number:5d} {got['p50_us']:8.0f} {got['p99_us']:8.0f} {ratios[0]:6.2f} "
                    f"{ratios[1]:6.2f} {got['missed']:3.0f}/{got['sent']:3.0f} {got['cpu_percent']:6.1f}",
                    flush=True,
                )
    print("\nmedian ratio to the MAVSDK script on the same wire (p50, p99)")
    for (wire, end), ratios in table.items():
        print(
            f"{wire:6} {end:10} {median(r[0] for r in ratios):6.2f} {median(r[1] for r in ratios):6.2f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--port", type=int, default=0, help=argparse.SUPPRESS)
    parser.add_argument("--as-vehicle", help=argparse.SUPPRESS)
    parser.add_argument("--as-end", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.as_vehicle:
        vehicle(arguments.as_vehicle, arguments.port, arguments.seconds)
    elif arguments.as_end and arguments.as_end[0] == "script":
        script_end(arguments.as_end[1], arguments.port)
    elif arguments.as_end:
        our_end(*arguments.as_end, arguments.port)
    else:
        compare(arguments.seconds, arguments.rounds)


if __name__ == "__main__":
    main()
