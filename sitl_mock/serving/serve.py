"""Run a fleet in real time: open its endpoints, report "ready", run until stopped, close everything."""

import contextlib
import gc
import json
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from sitl_mock.errors import ConfigError, imported_for
from sitl_mock.faults import Faulted, FaultScript
from sitl_mock.serving import console
from sitl_mock.serving.console import Shown
from sitl_mock.serving.fleet import FleetConfig, build, with_zenoh
from sitl_mock.serving.log_folder import LogFolder
from sitl_mock.transports import Endpoint, run, run_lockstep
from sitl_mock.transports.disturbance import Disturbances
from sitl_mock.transports.udp import UdpEndpoint
from sitl_mock.vehicle.link import TOPICS
from sitl_mock.vehicle.mock_vehicle import DEFAULT_LINKS

PX4_LOCAL_OFFSET = 40
"""PX4's simulation listens 40 ports above its target port: 14580 and 14540."""
ARDUPILOT_STEP = 10
"""ArduPilot's instances are ten ports apart: 14550, 14560."""
GCS_LOCAL_PORT = 18570


@dataclass(frozen=True)
class Wires:
    """Transports of a fleet.

    Attributes:
        zenoh: Endpoint to listen on; port 0 takes a free one.
        zenoh_connect: Endpoint to connect to instead.
        zenoh_keys: Credentials for the router (`transports.zenoh_session.read_keys`).
        udp: First port of the onboard links. As in their simulations, PX4 number i sends to udp + i and listens on
            udp + 40 + i (in fleets of more than 40 on any port), ArduPilot number i sends to udp + 10 i and listens on
            any port. Both answer every sender.
        px4_zenoh: Zenoh router that PX4's topics go to and come from, as from PX4's module `zenoh`.
        gcs: Port of a ground station. Vehicle i sends to it from port 18570 + i, or from a free port if that is taken.
    """

    zenoh: str | None = None
    zenoh_connect: str | None = None
    zenoh_keys: Path | None = None
    udp: int | None = None
    gcs: int | None = None
    px4_zenoh: str | None = None


@dataclass(frozen=True)
class Pace:
    """Who moves the vehicles' time.

    Attributes:
        speed: Seconds of the vehicles per real second.
        lockstep: Clients move it over MAVLink (`transports.lockstep`); `speed` has no effect.
    """

    speed: float = 1.0
    lockstep: bool = False

    def clock(self) -> float:
        """Monotonic seconds of the vehicles."""
        return time.monotonic() * self.speed


@dataclass(slots=True)
class Stop:
    """Stop flag set by signals, and the file descriptor that wakes the loop."""

    wake_fileno: int
    asked: bool = False

    def ask(self, _number: int, _frame: FrameType | None) -> None:
        """Handle a signal."""
        self.asked = True


def serve(
    config: FleetConfig,
    wires: Wires,
    faults: FaultScript = FaultScript(),  # noqa: B008 - an immutable value
    *,
    as_json: bool = False,
    parent_pipe: bool = False,
    pace: Pace = Pace(),
    logs: Path | None = None,
) -> None:
    """Run a fleet until SIGTERM, SIGINT or, with parent_pipe, the end of standard input.

    Args:
        config: The fleet.
        wires: Its transports.
        faults: Its faults.
        as_json: Print JSON for programs.
        parent_pipe: Also stop at the end of standard input.
        pace: Who moves its time.
        logs: Folder for its flight logs; None keeps them in memory only.

    Raises:
        ConfigError: No transport is given, or the fleet or the faults are wrong.
        TransportError: An endpoint cannot be opened.
    """
    if wires.zenoh_keys is not None and wires.zenoh_connect is None:
        raise ConfigError(f"--zenoh-keys {wires.zenoh_keys}: needs --zenoh-connect")
    if wires == Wires():
        raise ConfigError("no transport: give --zenoh tcp/127.0.0.1:7447, --udp 14540 or both")
    with contextlib.ExitStack() as stack:
        stop = stack.enter_context(_stop_signals())
        faulted = _built(config, wires, faults, pace)
        ports = {}
        if wires.udp is not None:
            flavours = {name: vehicle.vehicle.flavour for name, vehicle in faulted.items()}
            ports = udp_ports(wires.udp, flavours)
        endpoints = _opened(wires, ports, faulted, stack)
        disturbances = Disturbances(faulted, endpoints)
        targets = {name: target for name, (_, target) in ports.items()}
        screen = _say_ready(faulted, targets, endpoints, wires, as_json=as_json)
        if screen is not None:
            stack.callback(screen.close)
        folder = LogFolder(logs, faulted)
        stack.callback(folder.close)
        parent_fileno = sys.stdin.fileno() if parent_pipe else None
        watched = [stop.wake_fileno]
        if parent_fileno is not None:
            watched.append(parent_fileno)
        gc.collect()
        gc.freeze()  # a full collection would delay the loop by milliseconds

        def ended(ready: Collection[int]) -> bool:
            now_s = time.monotonic()
            disturbances.carry_out(now_s)
            if screen is not None:
                screen.update(now_s)
            folder.update(now_s)
            if parent_fileno is None or parent_fileno not in ready:
                return stop.asked
            return stop.asked or _at_end(parent_fileno)

        if pace.lockstep:
            run_lockstep(faulted, endpoints, ended, watched)
        else:
            run(faulted, endpoints, pace.clock, ended, watched, pace.speed)


def _built(
    config: FleetConfig, wires: Wires, faults: FaultScript, pace: Pace
) -> dict[str, Faulted]:
    """Make the vehicles with their faults; in lockstep their date does not depend on the present time."""
    unix_us = None if pace.lockstep else time.time_ns() // 1000 - round(pace.clock() * 1e6)
    links = dict(DEFAULT_LINKS)
    if wires.gcs is not None:
        links["gcs"] = "gcs"
    if wires.px4_zenoh is not None:
        links["px4_zenoh"] = TOPICS
        config = with_zenoh(config)
    vehicles = build(config, unix_us=unix_us, links=links)
    if not pace.lockstep:
        for vehicle in vehicles.values():
            vehicle.autopilot.signing.advance_to(time.time_ns() * 1e-9)
    faults.check_vehicles(list(vehicles))
    return {name: Faulted(vehicle, name, faults) for name, vehicle in vehicles.items()}


def _opened(
    wires: Wires,
    udp: dict[str, tuple[int, int]],
    vehicles: Mapping[str, Faulted],
    stack: contextlib.ExitStack,
) -> list[Endpoint]:
    """Open the endpoints; the stack closes them."""
    names = list(vehicles)
    endpoints: list[Endpoint] = []
    if udp:
        endpoints.append(
            stack.enter_context(contextlib.closing(UdpEndpoint("onboard", udp, time.monotonic)))
        )
    if wires.gcs is not None:
        ports = {name: (GCS_LOCAL_PORT + index, wires.gcs) for index, name in enumerate(names)}
        ground = UdpEndpoint("gcs", ports, time.monotonic, any_if_taken=True)
        endpoints.append(stack.enter_context(contextlib.closing(ground)))
    if wires.px4_zenoh is not None:
        with imported_for("--px4-zenoh"):
            from sitl_mock.transports.px4_zenoh import Px4ZenohEndpoint  # noqa: PLC0415 - as below

        domains = {
            name: int(vehicle.vehicle.autopilot.parameters["ZENOH_DOMAIN_ID"])
            for name, vehicle in vehicles.items()
            if "px4_zenoh" in vehicle.vehicle.links
        }
        topics = Px4ZenohEndpoint(domains, wires.px4_zenoh)
        endpoints.append(stack.enter_context(contextlib.closing(topics)))
    if wires.zenoh is not None or wires.zenoh_connect is not None:
        with imported_for("--zenoh"):
            from sitl_mock.faults import queryable  # noqa: PLC0415 - UDP does not need Zenoh
            from sitl_mock.transports.zenoh_session import (  # noqa: PLC0415 - UDP does not need Zenoh
                ZenohEndpoint,
                read_keys,
                with_port,
            )

        connect = wires.zenoh_connect is not None
        if wires.zenoh_keys is None:
            keys = {}
        else:
            keys = read_keys(wires.zenoh_keys)
        endpoint = wires.zenoh_connect or with_port(wires.zenoh or "")
        mode = "client" if connect else "router"
        opened = ZenohEndpoint(names, endpoint, mode=mode, connect=connect, keys=keys)
        endpoints.append(stack.enter_context(contextlib.closing(opened)))
        opened.declare(lambda session: queryable.declare(session, vehicles))
    return endpoints


def udp_ports(first: int, flavours: Mapping[str, str]) -> dict[str, tuple[int, int]]:
    """Return own port (0 for any) and target port of each vehicle, from its index and flavour.

    In a fleet of more than 40 vehicles the PX4 listen on any port, since their own ports would be other clients'.

    Raises:
        ConfigError: A port would be beyond 65535.
    """
    ports = {}
    for index, (name, flavour) in enumerate(flavours.items()):
        if flavour.partition("@")[0] != "px4":
            ports[name] = (0, first + ARDUPILOT_STEP * index)
        elif len(flavours) > PX4_LOCAL_OFFSET:
            ports[name] = (0, first + index)
        else:
            ports[name] = (first + PX4_LOCAL_OFFSET + index, first + index)
    highest = max(max(pair) for pair in ports.values())
    if highest > 65535:
        raise ConfigError(
            f"udp = {first}: {len(ports)} vehicles would need ports up to {highest}; allowed is up to 65535"
        )
    return ports


def _say_ready(
    vehicles: Mapping[str, Faulted],
    targets: Mapping[str, int],
    endpoints: Sequence[Endpoint],
    wires: Wires,
    *,
    as_json: bool,
) -> Shown | None:
    """Print each vehicle's addresses, as JSON or as text; with text, return the display of the status."""
    if as_json:
        addresses = [
            {
                "name": name,
                "flavour": vehicle.vehicle.flavour,
                "system_id": vehicle.vehicle.system_id,
                "endpoints": [
                    places[name]
                    for endpoint in endpoints
                    if name in (places := endpoint.describe())
                ],
                "clients": console.client_lines(targets[name]) if name in targets else {},
            }
            for name, vehicle in vehicles.items()
        ]
        lines = [json.dumps({"event": "ready", "vehicles": addresses})]
    else:
        first = next(iter(vehicles))
        zenoh = next(
            (
                place.split()[0]
                for endpoint in endpoints
                if "mavlink_raw" in (place := endpoint.describe().get(first, ""))
            ),
            None,
        )
        lines = [*console.welcome(vehicles, targets, wires.gcs, zenoh), "ready"]
    read = console.write(sys.stdout, "\n".join(lines))
    return console.shown(list(vehicles.values()), sys.stdout) if read and not as_json else None


@contextlib.contextmanager
def _stop_signals() -> Iterator[Stop]:
    """SIGTERM and SIGINT set a flag and wake the loop."""
    reader, writer = socket.socketpair()
    reader.setblocking(False)
    writer.setblocking(False)
    stop = Stop(reader.fileno())
    old_wakeup = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    old = {number: signal.signal(number, stop.ask) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield stop
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(old_wakeup)
        reader.close()
        writer.close()


def _at_end(fileno: int) -> bool:
    """True if the other end of a pipe has been closed; its data are discarded."""
    while select.select([fileno], [], [], 0.0)[0]:
        try:
            if not os.read(fileno, 4096):
                return True
        except OSError:
            return True
    return False
