"""The MAVSDK example takes off and lands on a mock at several speeds: how long do the vehicle and the client take?

python -m tests.bench.bench_speed --speeds 1 5
"""

import argparse
import sys
import time
from pathlib import Path

from sitl_mock.child import running

sys.path.insert(0, str(Path(__file__).parents[2] / "docs/examples"))

import takeoff_mavsdk
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.telemetry import Telemetry

HEIGHT_M = 10.0


def flown_s(speed: float) -> tuple[float, float]:
    """Fly the example; return real seconds of the whole script after the connection, and of the time in the air."""
    table = {"name": "uav1", "flavour": "px4", "ready_after_s": 0.5}
    with (
        running([table], over=("udp",), speed=speed) as fleet,
        Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk,
    ):
        mavsdk.add_any_connection(fleet["uav1"].udp)
        system = mavsdk.first_autopilot(20.0)
        telemetry = Telemetry(system)
        armed_s = []
        telemetry.subscribe_armed(
            lambda armed, _: armed_s.append(time.monotonic()) if armed else None
        )
        begun_s = time.monotonic()
        takeoff_mavsdk.fly(system, HEIGHT_M, 2.0 / speed)
        ended_s = time.monotonic()
        return ended_s - begun_s, ended_s - armed_s[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--speeds", type=float, nargs="+", default=[1.0, 5.0])
    parser.add_argument("--runs", type=int, default=1)
    arguments = parser.parse_args()
    for _ in range(arguments.runs):
        for speed in arguments.speeds:
            whole_s, armed_s = flown_s(speed)
            print(f"--speed {speed:g}: {whole_s:.1f} s, {armed_s:.1f} s of them armed", flush=True)


if __name__ == "__main__":
    main()
