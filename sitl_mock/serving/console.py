"""Console output of a running fleet: how to connect to each vehicle, and its state.

On a terminal the state is a table, redrawn twice a second; otherwise a line per change. Output never blocks the
vehicles.
"""

from __future__ import annotations

import os
import select
from itertools import chain
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, TextIO

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.table import Table

    from sitl_mock.faults import Faulted

TABLE_S: Final = 0.5
LINES_S: Final = 0.1
SHORT_FLEET: Final = 4
"""Up to this size each vehicle has one line per client; in larger fleets each vehicle has one line."""


class Status(NamedTuple):
    """State of one vehicle.

    Attributes:
        name: Its name in the fleet.
        flavour: px4, arducopter or rover.
        system_id: MAVLink system id.
        mode: Name of the mode that is flown.
        armed: Whether it is armed.
        height_m: Estimated height above home.
        clients: Senders of the last seconds, as `system/component`.
        faults: Kinds of the faults that act now.
    """

    name: str
    flavour: str
    system_id: int
    mode: str
    armed: bool
    height_m: float
    clients: str
    faults: str


class Shown(Protocol):
    """Display of a fleet's status."""

    def update(self, now_s: float) -> None:
        """Show changes when an update is due."""
        ...

    def close(self) -> None:
        """Stop the display."""
        ...


def client_lines(udp_port: int) -> dict[str, str]:
    """Return what to type in each client to connect to a vehicle that sends to this UDP port."""
    return {
        "MAVSDK": f"udpin://127.0.0.1:{udp_port}",
        "pymavlink": f'mavutil.mavlink_connection("udpin:127.0.0.1:{udp_port}")',
        "MAVProxy": f"mavproxy.py --master=udpin:127.0.0.1:{udp_port}",
    }


def welcome(
    vehicles: Mapping[str, Faulted], udp: Mapping[str, int], gcs: int | None, zenoh: str | None
) -> list[str]:
    """Return lines that tell how to connect to each vehicle.

    Args:
        vehicles: The fleet, by name.
        udp: Target port of each vehicle on this machine; empty without UDP.
        gcs: The ground station's port.
        zenoh: Endpoint for Zenoh clients.
    """
    lines = []
    in_short = len(vehicles) > SHORT_FLEET
    for name, vehicle in vehicles.items():
        mock = vehicle.vehicle
        title = f"{vehicle.name}: {mock.autopilot.flavour.title}, system id {mock.system_id}"
        if in_short:
            lines.append(f"{title}, udpin://127.0.0.1:{udp[name]}" if name in udp else title)
            continue
        lines.append(title)
        if name in udp:
            lines += [f"  {client:<10} {line}" for client, line in client_lines(udp[name]).items()]
    if in_short and udp:
        lines.append("These are MAVSDK's URLs; pymavlink and MAVProxy write udpin:127.0.0.1:PORT.")
    if gcs is not None:
        lines.append(
            f"QGroundControl: opens all vehicles by itself (UDP port {gcs})"
            if gcs == 14550
            else f"ground station: listens on UDP port {gcs} (in QGroundControl a UDP comm link)"
        )
    if zenoh is not None:
        lines += [
            f"Zenoh: {zenoh}",
            "  a vehicle's name is its namespace, mavlink_raw/in and mavlink_raw/out its keys",
        ]
    return lines


def write(out: TextIO, text: str) -> bool:
    """Write a line; False if the reader has gone."""
    try:
        out.write(text + "\n")
        out.flush()
    except BrokenPipeError:
        # So that Python's flush at exit does not fail
        os.dup2(os.open(os.devnull, os.O_WRONLY), out.fileno())
        return False
    return True


def status_of(vehicle: Faulted) -> Status:
    """Return a vehicle's state."""
    mock = vehicle.vehicle
    now_s = mock.autopilot.state.now_s
    clients = dict.fromkeys(
        chain.from_iterable(link.clients(now_s) for link in mock.links.values())
    )
    acting = dict.fromkeys(
        str(fault["kind"]) for fault in vehicle.faults() if fault["state"] == "acting"
    )
    return Status(
        vehicle.name,
        mock.flavour,
        mock.system_id,
        mock.mode,
        mock.armed,
        round(mock.autopilot.report.relative_m, 1) + 0.0,  # no minus zero
        " ".join(f"{system}/{component}" for system, component in clients),
        " ".join(acting),
    )


def shown(vehicles: Sequence[Faulted], out: TextIO) -> Shown:
    """Return a table for a terminal that can redraw it, otherwise lines."""
    if out.isatty() and os.environ.get("TERM", "dumb") != "dumb":
        return LiveTable(vehicles, out)
    return ChangeLines(vehicles, out)


class LiveTable:
    """A table of all vehicles, drawn in place."""

    def __init__(self, vehicles: Sequence[Faulted], out: TextIO) -> None:
        from rich.console import Console  # noqa: PLC0415 - only for terminals: it takes 0.1 s
        from rich.live import Live  # noqa: PLC0415 - as above

        self._vehicles = vehicles
        self._next_s = 0.0
        self._live = Live(console=Console(file=out), auto_refresh=False)
        self._live.start()

    def update(self, now_s: float) -> None:
        """Draw the table, twice a second."""
        if now_s < self._next_s:
            return
        self._next_s = now_s + TABLE_S
        self._live.update(
            fleet_table([status_of(vehicle) for vehicle in self._vehicles]), refresh=True
        )

    def close(self) -> None:
        """Leave the last table where it is."""
        self._live.stop()


def fleet_table(fleet: Sequence[Status]) -> Table:
    """Return a table with one row per vehicle."""
    from rich import box  # noqa: PLC0415 - as above
    from rich.table import Table  # noqa: PLC0415 - as above

    table = Table(
        box=box.SIMPLE_HEAD, pad_edge=False, caption="Ctrl-C ends", caption_justify="left"
    )
    table.add_column("vehicle", no_wrap=True)
    table.add_column("flavour", no_wrap=True)
    table.add_column("mode", no_wrap=True, min_width=9)
    table.add_column("armed")
    table.add_column("height", justify="right", no_wrap=True, min_width=8)
    table.add_column("clients", overflow="ellipsis", no_wrap=True)
    table.add_column("faults", overflow="ellipsis", no_wrap=True, style="red")
    for vehicle in fleet:
        table.add_row(
            vehicle.name,
            vehicle.flavour,
            vehicle.mode,
            "[bold]armed[/]" if vehicle.armed else "-",
            f"{vehicle.height_m:.1f} m",
            vehicle.clients or "[dim]none[/]",
            vehicle.faults,
        )
    return table


class ChangeLines:
    """A line whenever a vehicle's mode, arming, clients or faults change, for pipes and files."""

    def __init__(self, vehicles: Sequence[Faulted], out: TextIO) -> None:
        self._vehicles = vehicles
        self._out: TextIO | None = out
        self._known: dict[str, Status] = {}
        self._next_s = 0.0
        self._first_s = -1.0

    def update(self, now_s: float) -> None:
        """Write changes; a line that would block is written later."""
        if self._out is None or now_s < self._next_s:
            return
        self._next_s = now_s + LINES_S
        if self._first_s < 0.0:
            self._first_s = now_s
        for vehicle in self._vehicles:
            status = status_of(vehicle)
            previous = self._known.get(vehicle.name)
            changed = previous is None or previous._replace(height_m=status.height_m) != status
            if changed and self._out is not None and select.select([], [self._out], [], 0.0)[1]:
                self._known[vehicle.name] = status
                if not write(self._out, line_of(status, now_s - self._first_s)):
                    self._out = None

    def close(self) -> None:
        """Do nothing: lines need no cleanup."""


def line_of(status: Status, since_s: float) -> str:
    """Return one vehicle's state as a line."""
    parts = [
        f"{since_s:8.1f} s",
        status.name,
        status.mode,
        "armed" if status.armed else "disarmed",
        f"{status.height_m:.1f} m",
        f"clients {status.clients or 'none'}",
    ]
    return "  ".join([*parts, f"faults {status.faults}"] if status.faults else parts)
