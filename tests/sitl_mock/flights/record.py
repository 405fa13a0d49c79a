"""Fly the flights on a real autopilot's simulator, and keep what a comparison needs of them.

    python -m tests.sitl_mock.flights.record px4 udpin://127.0.0.1:14540 goto
    python -m tests.sitl_mock.flights.record arducopter tcpout://127.0.0.1:5760 mission

Each flight wants a simulator that has just been started and is ready to arm: PX4 v1.17's SIH quadrotor, or ArduCopter
4.5.7's quadrotor with `copter.parm` at `mavproxy_flights.HOME`.
"""

import argparse
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk

from tests.sitl_mock.flights import mavproxy_flights, mavsdk_flights
from tests.sitl_mock.flights.mavproxy import Proxy
from tests.sitl_mock.flights.recorded import FOLDER, keep
from tests.sitl_mock.flights.relay import Relay

FLIGHTS: dict[str, Mapping[str, Any]] = {
    "px4": mavsdk_flights.FLIGHTS,
    "arducopter": mavproxy_flights.FLIGHTS,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("autopilot", choices=FLIGHTS)
    parser.add_argument(
        "vehicle", help="URL of the simulator: udpin://127.0.0.1:PORT or tcpout://127.0.0.1:PORT"
    )
    parser.add_argument(
        "flight", help=", ".join(sorted({name for flights in FLIGHTS.values() for name in flights}))
    )
    parser.add_argument(
        "--out", type=Path, default=FOLDER, help="folder of the recording (%(default)s)"
    )
    parser.add_argument(
        "--replace", action="store_true", help="write over a recording that is kept already"
    )
    parser.add_argument(
        "--port", type=int, default=14700, help="free UDP port for the client (%(default)s)"
    )
    arguments = parser.parse_args()
    if arguments.flight not in FLIGHTS[arguments.autopilot]:
        parser.error(
            f"{arguments.autopilot} has the flights {', '.join(FLIGHTS[arguments.autopilot])}"
        )
    kept = arguments.out / f"{arguments.autopilot}_{arguments.flight}.tlog.gz"
    if kept.exists() and not arguments.replace:
        parser.error(
            f"{kept} is there already: --replace writes over it, --out FOLDER puts this one elsewhere"
        )
    with tempfile.TemporaryDirectory() as folder:
        tlog = Path(folder) / "relay.tlog"  # MAVProxy writes a flight.tlog there
        with Relay(arguments.vehicle, arguments.port, tlog):
            by_mavsdk = arguments.autopilot == "px4"
            (_by_mavsdk if by_mavsdk else _by_mavproxy)(
                arguments.port, arguments.flight, Path(folder)
            )
        keep(tlog, kept)
    print(f"kept {kept}, {kept.stat().st_size} bytes")


def _by_mavsdk(port: int, name: str, _folder: Path) -> None:
    with Mavsdk(
        Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)
    ) as mavsdk:
        mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        system = mavsdk.first_autopilot(20.0)
        assert system is not None, "no autopilot within 20 s"
        mavsdk_flights.FLIGHTS[name](mavsdk_flights.Pilot(system).ready())


def _by_mavproxy(port: int, name: str, folder: Path) -> None:
    proxy = Proxy(port, folder)
    try:
        mavproxy_flights.fly(proxy, folder, name)
    finally:
        proxy.close()


if __name__ == "__main__":
    main()
