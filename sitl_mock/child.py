"""A fleet in a child process that is reliably ended, for test suites and examples.

with running([{"name": "uav1", "flavour": "px4", "ready_after_s": 1.0}]) as fleet:
    fleet["uav1"].udp           # udpin://127.0.0.1:25000, as MAVSDK wants it
    fleet["uav1"].zenoh         # tcp/127.0.0.1:41234, with fleet["uav1"].namespace
"""

from __future__ import annotations

import contextlib
import itertools
import json
import select
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import tomlkit

from sitl_mock.errors import ConfigError, TransportError
from sitl_mock.serving.serve import udp_ports

Over = Literal["udp", "zenoh"]

_FIRST_PORT = 21_000
_LAST_PORT = 31_000
_ATTEMPTS: Final = 5
START_S = 60.0
"""Longest wait for a child's addresses; on an idle machine they come within a second."""

_STOP_S = 5.0
_PORT_TAKEN: Final = 3
_ERRORS: Final = "errors.txt"


@dataclass(frozen=True)
class RunningVehicle:
    """Addresses of one vehicle.

    Attributes:
        name: Its name.
        flavour: px4, arducopter or rover.
        system_id: MAVLink system id.
        udp_port: The port on 127.0.0.1 where its client listens; None without UDP.
        udp_listens: The vehicle's own port.
        zenoh: Endpoint for a Zenoh client, None without Zenoh.
    """

    name: str
    flavour: str
    system_id: int
    udp_port: int | None = None
    udp_listens: int | None = None
    zenoh: str | None = None

    @property
    def udp(self) -> str:
        """The URL for MAVSDK; `udpin:127.0.0.1:<udp_port>` is pymavlink's and MAVProxy's."""
        return f"udpin://127.0.0.1:{self.udp_port}"

    @property
    def namespace(self) -> str:
        """The Zenoh namespace of mavlink_raw/in, mavlink_raw/out and faults."""
        return self.name


@dataclass(frozen=True)
class RunningFleet(Mapping[str, RunningVehicle]):
    """The vehicles of one child process, by name.

    Attributes:
        vehicles: Their addresses.
        process: The child; `running` ends it.
        log: File with its standard error.
    """

    vehicles: Mapping[str, RunningVehicle]
    process: subprocess.Popen[str]
    log: Path

    def __getitem__(self, name: str) -> RunningVehicle:
        return self.vehicles[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.vehicles)

    def __len__(self) -> int:
        return len(self.vehicles)

    def check(self) -> None:
        """Check that the child still runs.

        Raises:
            TransportError: It has ended; the message has its exit code and last output.
        """
        code = self.process.poll()
        if code is not None:
            words = _last_words(self.log)
            if not words:
                words = "without a message"
            raise TransportError(f"the mock autopilot ended in flight (exit code {code}): {words}")


@contextlib.contextmanager
def running(
    vehicles: Sequence[Mapping[str, Any]],
    *,
    over: Sequence[Over] = ("udp", "zenoh"),
    faults: Mapping[str, Any] | None = None,
    port: int = 0,
    seed: int = 0,
    speed: float = 1.0,
    lockstep: bool = False,
    px4_zenoh: str | None = None,
    **fleet: Any,  # noqa: ANN401 - further keys of a fleet file
) -> Iterator[RunningFleet]:
    """Run a fleet in a child process on 127.0.0.1; it ends with the block, or with this process.

    Args:
        vehicles: The `[[vehicle]]` tables of a fleet file: name, flavour, ready_after_s, parameters, ...
        over: Transports to open.
        faults: The tables of a faults file.
        port: First UDP port of the onboard links, or without UDP the port of the Zenoh session; 0 picks free ones.
        seed: Seed of all randomness.
        speed: Seconds of the vehicles per real second.
        lockstep: Time advances only when a client asks for it.
        px4_zenoh: Zenoh router of PX4's own topics; None for none.
        fleet: Other keys of a fleet file, such as home.

    Raises:
        ConfigError: A key is unknown or wrong.
        TransportError: It did not start.
    """
    unknown = sorted(set(over) - {"udp", "zenoh"})
    if unknown or not over:
        raise ConfigError(f"over = {tuple(over)!r}: allowed are udp and zenoh")
    flavours = {
        str(vehicle.get("name")): str(vehicle.get("flavour", "px4")) for vehicle in vehicles
    }
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        tables = {
            "seed": seed,
            **fleet,
            "vehicle": [
                {key: value for key, value in vehicle.items() if value is not None}
                for vehicle in vehicles
            ],
        }
        (folder / "fleet.toml").write_text(tomlkit.dumps(tables), encoding="utf-8")
        (folder / "faults.toml").write_text(
            tomlkit.dumps({} if faults is None else faults), encoding="utf-8"
        )
        for _ in range(1 if port else _ATTEMPTS):
            udp = None
            if "udp" in over:
                udp = port if port else _free_ports(flavours, stack)
            # The Zenoh endpoint has the given port only if UDP does not.
            zenoh = None
            if "zenoh" in over:
                zenoh = port if udp is None else 0
            if lockstep:
                pace = ["--lockstep"]
            else:
                pace = ["--speed", f"{speed:g}"]
            if px4_zenoh is not None:
                pace += ["--px4-zenoh", px4_zenoh]
            process = _start(folder, udp, zenoh, pace)
            stack.callback(end, process)
            # The "ready" line; empty if the child ended, None if it took too long.
            line = None
            if process.stdout is not None and select.select([process.stdout], [], [], START_S)[0]:
                line = process.stdout.readline()
            if line:
                ports = {} if udp is None else udp_ports(udp, flavours)
                targets = {name: target for name, (_, target) in ports.items()}
                addresses = _addresses(json.loads(line), targets)
                yield RunningFleet(addresses, process, folder / _ERRORS)
                return
            end(process)
            if process.returncode != _PORT_TAKEN:
                break
        error = ConfigError if process.returncode == ConfigError.exit_code else TransportError
        why = f"it ended with exit code {process.returncode} before it gave an address"
        if line is None:
            why = f"it gave no address within {START_S:g} s; the machine may be too busy"
        last_words = _last_words(folder / _ERRORS)
        raise error(last_words if last_words else why)


def end(process: subprocess.Popen[str]) -> None:
    """End a child by closing its standard input, or by force after 5 s."""
    if process.stdin is not None:
        with contextlib.suppress(OSError):
            process.stdin.close()
    try:
        process.wait(_STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()


def _start(
    folder: Path, udp: int | None, zenoh: int | None, pace: Sequence[str]
) -> subprocess.Popen[str]:
    command = [sys.executable, "-P", "-m", "sitl_mock", "run", "--json", "--parent-pipe"]
    command += ["--fleet", str(folder / "fleet.toml"), "--faults", str(folder / "faults.toml")]
    command += pace
    if udp is not None:
        command += ["--udp", str(udp)]
    if zenoh is not None:
        command += ["--zenoh", f"tcp/127.0.0.1:{zenoh}"]
    with (folder / _ERRORS).open("w", encoding="utf-8") as errors:  # an unread pipe would fill up
        return subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            encoding="utf-8",
            # Ctrl-C is for the parent: the child ends when its standard input closes. In a session of its own, its
            # priority would count for nothing outside that session (Linux, sched(7): autogroup).
            process_group=0,
        )


def _last_words(log: Path) -> str:
    """Return the last error or line in a child's log."""
    output = log.read_text(encoding="utf-8", errors="replace").strip()
    return output.rpartition("error: ")[2] if "error: " in output else output.rpartition("\n")[2]


def _addresses(ready: Mapping[str, Any], targets: Mapping[str, int]) -> dict[str, RunningVehicle]:
    vehicles = {}
    for vehicle in ready["vehicles"]:
        name = vehicle["name"]
        places = vehicle["endpoints"]
        zenoh = next(
            (endpoint.split()[0] for endpoint in places if "mavlink_raw" in endpoint), None
        )
        listens = next(
            (int(endpoint.rsplit(":", 1)[1]) for endpoint in places if endpoint.startswith("udp:")),
            None,
        )
        vehicles[name] = RunningVehicle(
            name, vehicle["flavour"], vehicle["system_id"], targets.get(name), listens, zenoh
        )
    return vehicles


def free_udp_port(flavours: Mapping[str, str]) -> int:
    """Return a first port such that all ports of the vehicles and their clients are free now.

    Raises:
        TransportError: None is found.
    """
    with contextlib.ExitStack() as stack:
        return _free_ports(flavours, stack)


def _free_ports(flavours: Mapping[str, str], stack: contextlib.ExitStack) -> int:
    """Return a first port such that all ports of the vehicles and their clients are free now.

    The client's UDP port must stay unbound for the client. To keep fleets that start at the same time apart, the TCP
    ports with the same numbers are bound until the stack is closed.
    """
    spread = max(max(pair) for pair in udp_ports(0, flavours).values()) + 1
    # The system's choice spreads test runs that start at the same time.
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    first = _FIRST_PORT + port % (_LAST_PORT - _FIRST_PORT)
    for start in itertools.chain(
        range(first, _LAST_PORT, spread), range(_FIRST_PORT, first, spread)
    ):
        pairs = udp_ports(start, flavours).values()
        ports = [port for port in itertools.chain.from_iterable(pairs) if port]
        if len(set(ports)) < len(ports):
            raise TransportError(
                f"{', '.join(flavours)}: their UDP ports would clash; start them as two fleets"
            )
        with contextlib.ExitStack() as held:
            for port in ports:
                holder = held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_STREAM))
                try:
                    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                        probe.bind(("127.0.0.1", port))
                    holder.bind(("127.0.0.1", port))
                except OSError:  # another fleet has it, or its UDP port is not free
                    break
            else:
                stack.push(held.pop_all())
                return start
    raise TransportError(f"no free UDP ports from {_FIRST_PORT} to {_LAST_PORT} on 127.0.0.1")
