"""`python -m tests acceptance`: acceptance flights of the service, on running SITLs or on mocks over UDP.

With `--px4 URL` or `--arducopter URL` all flights are flown on that SITL in real time, one after another; both
autopilots fly at the same time. Without a URL each flight gets its own mock over UDP, with the autopilots that its case
lists, some of them in virtual time; `--all` flies every case on both in real time. PX4's mock flies two of them also as
a flight mode over its own topics. Several mocks fly at a time.
With `--team URL URL URL` three autopilots fly as a team. With `--px4-mode` PX4 is flown as a flight mode.
"""

import argparse
import contextlib
import html
import multiprocessing
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

from guidance.errors import GuidanceError
from guidance.links.zenoh.session import direct_session
from guidance.session.fly.loop import LOOP_NICE
from sitl_mock.child import free_udp_port, running
from sitl_mock.errors import MockError
from tests.acceptance import ground_station
from tests.acceptance.cases import Case, cases, toml
from tests.acceptance.flying import GUIDANCE, Line, fly, fly_in_virtual_time
from tests.acceptance.relay import LASTING, SET_UP, Relay, wait
from tests.acceptance.team import fly_all
from tests.harness.starved import Waiting

AUTOPILOTS = ("px4", "arducopter")
READY_WITHIN_S = 120.0
DOWN_WITHIN_S = 240.0
SIGNING = ("arducopter",)
"""Autopilots that sign; PX4 v1.17 cannot."""

STARVED = 3
"""The exit code if every flight that did not hold had no processor."""

AS_A_MODE = "zenoh"
MODE_FLIGHTS = ("at full speed at once, u 6 v 3", "a pilot's mode switch")
"""Flights that PX4's mock flies also as a flight mode over its own topics."""

AT_A_TIME = 4
"""In real time. A flight takes up to 0.3 of a processor: of two, six flights leave nothing to the steps beside them."""

SHORT = ("pilot", "kill", "refuse")
"""Interference that ends a flight early; such flights begin last."""

LATER = 12
"""Added to the niceness of flights in virtual time, which can wait."""

SIM_HEIGHT_M = 20.0
STAND_IN_HEIGHT_M = 8.0
SOON_UP_AND_DOWN = {
    "px4": {"COM_SPOOLUP_TIME": 0.2, "MPC_TKO_RAMP_T": 0.5, "MPC_TKO_SPEED": 4.0, "MPC_LAND_SPEED": 2.0,
            "COM_DISARM_LAND": 0.3},
    "arducopter": {"WPNAV_SPEED_UP": 400.0, "LAND_SPEED": 150.0, "DISARM_DELAY": 1.0},
}  # fmt: skip
"""Parameters of the mocks only. They shorten take-off and landing, which no condition is about."""

VERDICTS = {True: "ok", False: "NO", None: "starved"}
Tell = Callable[[Line], None]


class Flight(NamedTuple):
    """A flight on mocks: its folder's name, what flies it, and whether it is in virtual time."""

    name: str
    fly: Callable[[Path], list[Line]]
    virtual: bool = False


def on_a_url(
    autopilot: str,
    url: str,
    stations: Sequence[str],
    folder: Path,
    tell: Tell,
    only: str,
    mode_url: str | None = None,
) -> None:
    """Set up the vehicle, then fly all cases on it, and with ground stations on other links of it."""
    with_relay = _Relays(url, mode_url)
    try:
        relay = with_relay.fresh()
        if relay.profile.name != autopilot:
            tell(
                Line(
                    autopilot, "set up", "", autopilot, f"{relay.profile.name} is there", held=False
                )
            )
            return
        if not _set_up(relay, folder / "set-up", tell):
            return
        if autopilot == "arducopter":
            relay.set(*LASTING)
        if not _fly_cases(with_relay, autopilot, folder, tell, only):
            return
        with_relay.close()
        for line in _with_stations(autopilot, url, stations, folder, only):
            tell(line)
    except GuidanceError as error:
        tell(Line(autopilot, "the vehicle", "", "reached", str(error), held=False))
    finally:
        with_relay.close()


def _fly_cases(with_relay: "_Relays", autopilot: str, folder: Path, tell: Tell, only: str) -> bool:
    """Fly all cases; return whether the vehicle came down after each."""
    for number, case in enumerate(_chosen(autopilot, SIM_HEIGHT_M, only), start=1):
        relay = with_relay.fresh()
        name = f"{number:02d}-{_slug(f'{case.name} {case.link}')}"
        for line in fly(case, relay, folder / name, end="return"):
            tell(line)
        if not relay.bring_down(within_s=DOWN_WITHIN_S):
            tell(Line(autopilot, case.name, case.link, "down again", "still armed", held=False))
            return False
    return True


def _with_stations(
    autopilot: str, url: str, stations: Sequence[str], folder: Path, only: str
) -> list[Line]:
    """Fly with ground stations on other links of the autopilot, which forwards between them."""
    lines = list[Line]()
    if stations and only in ground_station.FLIGHT:
        lines += ground_station.fly(autopilot, url, stations, folder / "ground-station")
    if stations and only in ground_station.SIGNED_FLIGHT and autopilot in SIGNING:
        lines += ground_station.fly_signed(autopilot, url, stations[0], folder / "signed")
    return lines


class _Relays:
    """Successive relays on one URL."""

    def __init__(self, url: str, mode_url: str | None) -> None:
        self._url = url
        self._mode_url = mode_url
        self._relay: Relay | None = None

    def fresh(self) -> Relay:
        self.close()
        port = free_udp_port({"uav1": "px4"})
        self._relay = Relay(self._url, port, mode_url=self._mode_url)
        return self._relay

    def close(self) -> None:
        """Leave the URL; may be called twice."""
        if self._relay is not None:
            self._relay.close()
            self._relay = None


def _set_up(relay: Relay, folder: Path, tell: Tell) -> bool:
    """Set the parameters with `guidance check --apply`; repeat while the vehicle is starting."""
    name = relay.profile.name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scenario.toml").write_text(
        toml(cases(name, height_m=SIM_HEIGHT_M)[2].scenario), encoding="utf-8"
    )
    command = [
        GUIDANCE,
        "check",
        folder / "scenario.toml",
        *relay.options,
        "--apply",
        "--yes",
    ]
    said = subprocess.CompletedProcess[str]([], 4, "", "")

    def passes() -> bool:
        nonlocal said
        said = subprocess.run(
            [*map(str, command)], capture_output=True, text=True, timeout=90, check=False
        )
        return said.returncode == 0

    held = wait(passes, READY_WITHIN_S)
    words = (
        "nothing is refused"
        if held
        else (said.stdout + said.stderr).strip().splitlines()[-1][-160:]
    )
    tell(Line(name, "set up", "mavsdk", "check --apply refuses nothing", words, held))
    return held


def on_the_mock(autopilot: str, case: Case, folder: Path) -> list[Line]:
    """Fly one case on a mock of its own."""
    try:
        with contextlib.ExitStack() as stack:
            topics = None
            if case.link == AS_A_MODE:
                with socket.create_server(("127.0.0.1", 0)) as probe:
                    topics = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
                stack.enter_context(direct_session("router", {"listen": {"endpoints": [topics]}}))
            vehicle = _mock(autopilot)
            fleet = stack.enter_context(running([vehicle], over=["udp"], px4_zenoh=topics))
            mode_url = None if topics is None else topics.replace("tcp/", "zenoh+tcp://")
            port = free_udp_port({"uav1": "px4"})
            relay = Relay(fleet["uav1"].udp, port, mode_url=mode_url)
            stack.callback(relay.close)
            return fly(case, relay, folder, end="land")
    except (GuidanceError, MockError) as error:
        return [_not_flown(autopilot, case.name, case.link, error)]


def beside_ground_stations(autopilot: str, flight: str, folder: Path) -> list[Line]:
    """Fly on a mock of its own, whose relay forwards between guidance's link and two ground stations."""
    try:
        with running([_mock(autopilot)], over=["udp"]) as fleet:
            client_port, *station_ports = (free_udp_port({"uav1": "px4"}) for _ in range(3))
            stations = [f"udpin://127.0.0.1:{port}" for port in station_ports]
            relay = Relay(fleet["uav1"].udp, client_port, station_ports=station_ports)
            with contextlib.closing(relay):
                if flight == ground_station.SIGNED_FLIGHT:
                    url = stations[0]
                    return ground_station.fly_signed(autopilot, relay.client_url, url, folder)
                return ground_station.fly(autopilot, relay.client_url, stations, folder)
    except (GuidanceError, MockError) as error:
        return [_not_flown(autopilot, flight, "", error)]


def _mock(autopilot: str) -> dict[str, object]:
    """Return the vehicle of a fleet that is set up, takes off and lands fast."""
    return {
        "name": "uav1",
        "flavour": autopilot,
        "ready_after_s": 0.5,
        "parameters": SET_UP[autopilot] | SOON_UP_AND_DOWN[autopilot],
    }


def _not_flown(autopilot: str, flight: str, link: str, error: Exception) -> Line:
    words = f"{type(error).__name__}: {error}"
    return Line(autopilot, flight, link, "a flight", words, held=False)


def _chosen(autopilot: str, height_m: float, only: str) -> list[Case]:
    return [case for case in cases(autopilot, height_m=height_m) if only in case.name]


def _on_mocks(only: str, *, everything: bool) -> Iterator[tuple[str, Case]]:
    for autopilot in AUTOPILOTS:
        for case in _chosen(autopilot, STAND_IN_HEIGHT_M, only):
            if everything or autopilot in case.autopilots:
                yield autopilot, case
            if autopilot == "px4" and case.name in MODE_FLIGHTS:
                yield autopilot, replace(case, link=AS_A_MODE, virtual=False)


def _flights(only: str, process: Executor, *, everything: bool, drawn: bool) -> Iterator[Flight]:
    """Yield the flights on mocks; those that last longest come first, so that none of them is alone at the end."""
    for name in (ground_station.FLIGHT, ground_station.SIGNED_FLIGHT):
        for autopilot in AUTOPILOTS if name == ground_station.FLIGHT else SIGNING:
            if only in name:
                fly = partial(beside_ground_stations, autopilot, name)
                yield Flight(f"{autopilot}-{_slug(name)}", fly)
    chosen = sorted(
        _on_mocks(only, everything=everything), key=lambda one: one[1].meddling in SHORT
    )
    for autopilot, case in chosen:
        name = f"{autopilot}-{_slug(f'{case.name} {case.link}')}"
        if case.virtual and not everything:
            fly = partial(fly_in_virtual_time, case, autopilot, process=process, drawn=drawn)
            yield Flight(name, fly, virtual=True)
        else:
            yield Flight(name, partial(on_the_mock, autopilot, case))


def _slug(name: str) -> str:
    return "".join(letter if letter.isalnum() else "-" for letter in name).strip("-")


def _unknown(lines: Sequence[Line], starved: str) -> list[Line]:
    """Return the lines; those that did not hold are unknown, because a process had no processor."""
    return [
        line if line.held else line._replace(got=f"{line.got}; {starved}", held=None)
        for line in lines
    ]


def _tell_all(tell: Tell, lines: Sequence[Line]) -> None:
    for line in lines:
        tell(line)


@contextlib.contextmanager
def favoured() -> Iterator[None]:
    """Let mocks, relays and clients go first on a busy machine; a flight's own loop claims more, as a user's does."""
    before = os.getpriority(os.PRIO_PROCESS, 0)
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, LOOP_NICE)
    try:
        yield
    finally:
        with contextlib.suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, 0, before)


def stand_ins(folder: Path, tell: Tell, only: str, *, everything: bool, drawn: bool = True) -> None:
    """Fly on mocks, several in real time at a time, and beside them one in virtual time.

    A failed flight is flown again alone at the end; if it fails again for want of a processor, it is starved.
    """

    def flown(flight: Flight) -> list[Line]:
        return flight.fly(folder / flight.name)

    def flown_again(flight: Flight) -> list[Line]:
        with Waiting() as waiting:
            lines = flight.fly(folder / f"{flight.name}-again")
        if not flight.virtual and (starved := waiting.starved()):
            return _unknown(lines, starved)
        return lines

    spawned = multiprocessing.get_context("spawn")  # a fork would copy locks of other threads
    with (
        ProcessPoolExecutor(1, spawned, os.nice, (LATER,)) as process,
        ThreadPoolExecutor(1) as virtual,
        ThreadPoolExecutor(AT_A_TIME) as real,
    ):
        flights = list(_flights(only, process, everything=everything, drawn=drawn))
        begun = [(virtual if flight.virtual else real).submit(flown, flight) for flight in flights]
        unsure = list[Flight]()
        for flight, future in zip(flights, begun, strict=True):
            lines = future.result()
            wrong = next((line for line in lines if not line.held), None)
            if wrong is None:
                _tell_all(tell, lines)
                continue
            unsure.append(flight)
            words = f"{wrong.wanted}, got {wrong.got}; it is flown again alone at the end"
            print(f"{wrong.autopilot}, {wrong.flight}: {words}", flush=True)
        for flight in unsure:
            _tell_all(tell, flown_again(flight))


def main(arguments: Sequence[str]) -> int:
    """Fly, show the table; return 0 if everything held."""
    parser = argparse.ArgumentParser(prog="python -m tests acceptance", description=__doc__)
    for autopilot in AUTOPILOTS:
        parser.add_argument(
            f"--{autopilot}", metavar="URL", help="IT IS ARMED AND FLOWN; see docs/acceptance.md"
        )
        parser.add_argument(
            f"--{autopilot}-stations",
            metavar="URL",
            nargs="+",
            default=[],
            help="one or two other links of it, for ground stations",
        )
    parser.add_argument(
        "--team", metavar="URL", nargs=3, help="three vehicles: THEY ARE ARMED AND FLOWN as a team"
    )
    parser.add_argument(
        "--px4-mode",
        metavar="URL",
        nargs="+",
        default=[],
        help="with --px4: fly as a mode of PX4 on its Zenoh router, zenoh+tcp://127.0.0.1:7447; with --team: three",
    )
    parser.add_argument("--report", type=Path, help="folder for records, pictures and the table")
    parser.add_argument("--only", default="", help="flights with these words in their name")
    parser.add_argument(
        "--all", action="store_true", help="without a URL: every flight on both mocks"
    )
    given = parser.parse_args(arguments)
    if given.px4_mode and len(given.px4_mode) != len(given.team or [given.px4]):
        parser.error("--px4-mode: as many URLs as vehicles")
    if given.report is not None and given.report.exists() and any(given.report.iterdir()):
        parser.error(
            f"--report {given.report}: is not empty; flights already flown stay, so give a new folder"
        )
    console = Console()
    lock = threading.Lock()
    lines: list[Line] = []
    began_s = time.monotonic()

    def tell(line: Line) -> None:
        with lock:
            lines.append(line)
            mark = (
                "[green]ok[/green]" if line.held else f"[bold red]{VERDICTS[line.held]}[/bold red]"
            )
            words = f"{line.autopilot}, {line.flight} ({line.link}): wanted {line.wanted}, got {line.got}"
            console.print(
                f"{time.monotonic() - began_s:6.0f} s ",
                mark,
                words,
                highlight=False,
                soft_wrap=True,
            )

    with favoured(), tempfile.TemporaryDirectory(prefix="acceptance-") as scratch:
        folder = given.report if given.report is not None else Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        urls = {
            autopilot: getattr(given, autopilot)
            for autopilot in AUTOPILOTS
            if getattr(given, autopilot)
        }
        if given.team:
            modes = given.px4_mode or [None] * len(given.team)
            fly_all(given.team, modes, folder / "team", tell, given.only)
        elif urls:
            threads = [
                threading.Thread(
                    target=on_a_url,
                    args=(
                        name,
                        url,
                        getattr(given, f"{name}_stations"),
                        folder / name,
                        tell,
                        given.only,
                        given.px4_mode[0] if given.px4_mode and name == "px4" else None,
                    ),
                )
                for name, url in urls.items()
            ]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        else:
            reported = given.report is not None
            stand_ins(folder, tell, given.only, everything=given.all, drawn=reported)
        lines.sort(key=lambda line: (line.autopilot, line.flight, line.link))
        (folder / "acceptance.html").write_text(_page(lines, folder), encoding="utf-8")
    Console(width=max(console.width, 170)).print(_table(lines))
    unknown = sum(line.held is None for line in lines)
    failed = sum(not line.held for line in lines) - unknown
    held = f"{len(lines) - failed - unknown} of {len(lines)} as wanted, {unknown} starved"
    console.print(f"{held}, in {time.monotonic() - began_s:.0f} s")
    return 1 if failed or not lines else STARVED * bool(unknown)


def _table(lines: Sequence[Line]) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in (*Line._fields[:-1], ""):
        table.add_column(heading, overflow="fold")
    for line in lines:
        table.add_row(*line[:-1], VERDICTS[line.held], style="" if line.held else "bold red")
    return table


def _page(lines: Sequence[Line], folder: Path) -> str:
    """The same table as a page, with every flight's picture."""
    rows = "".join(
        f"<tr style='color:{'inherit' if line.held else '#b00'}'>"
        + "".join(f"<td>{html.escape(cell)}</td>" for cell in (*line[:-1], VERDICTS[line.held]))
        + "</tr>"
        for line in lines
    )
    pictures = "".join(
        f"<figure><img src='{path.relative_to(folder)}' style='max-width:60em'><figcaption>"
        f"{html.escape(path.parent.name)}</figcaption></figure>"
        for path in sorted(folder.rglob("flight.png"))
    )
    heads = "".join(f"<th>{name}</th>" for name in (*Line._fields[:-1], ""))
    return f"<!doctype html><meta charset='utf-8'><title>acceptance</title><table>{heads}{rows}</table>{pictures}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
