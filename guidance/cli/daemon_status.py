"""A daemon's status as a table, once or as it changes."""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.text import Text

from guidance.screen import Cell, pairs, redraws

WATCH_S: Final = 1.0
Status = Mapping[str, Any]


def status_table(status: Status) -> RenderableType:
    """Lay out a daemon's status: state, telemetry, game and failed checks."""
    return Group(pairs(_rows(status)), *_to_do(status))


def _rows(status: Status) -> Iterator[tuple[str, Cell]]:
    yield "vehicle", str(status.get("name", "-"))
    yield "state", Text(str(status.get("state", "-")), "bold")
    if "waiting_for" in status:
        limit = status["connect_timeout_s"]
        yield "waiting", f"for {status['waiting_for']}, {status['waited_s']:.0f} s so far, {limit:.0f} s at most"
        return
    if status.get("next"):
        yield "next", Text(str(status["next"]), "yellow")
    armed = "armed" if status.get("armed") else "disarmed"
    streaming = "setpoints are sent" if status.get("streaming") else "no setpoints are sent"
    yield "autopilot", f"{status.get('autopilot_mode', status.get('mode'))}, {armed}, {streaming}"
    yield "heard", f"HEARTBEAT {_age(status, 'heartbeat_age_s')}, position {_age(status, 'position_age_s')}"
    yield from _flown(status)
    yield "evader", f"heard {_age(status, 'evader_silence_s')}"
    yield from _game(status)
    yield "record", str(status.get("recording", "-"))


def _flown(status: Status) -> Iterator[tuple[str, Cell]]:
    if "height_m" not in status:
        return
    north, east, down = status["velocity_ned_m_s"]
    yield "height", f"{_tenths(status['height_m'])} m above home"
    n, e, _ = status["position_ned_m"]
    yield "position", f"{_tenths(n)} m north, {_tenths(e)} m east of the origin"
    yield "speed", f"{math.hypot(north, east):.1f} m/s level, {_tenths(-down)} m/s up"
    battery = status.get("battery")
    yield "battery", "not told" if battery is None else f"{battery:.0%}"


def _game(status: Status) -> Iterator[tuple[str, Cell]]:
    game = status.get("certificate")
    if not game:
        return
    yield "range", f"{status['range_m']:.1f} m to the evader, {_number(game, 'gap_m')} m to the stand-off disc's rim"
    value = f"{_number(game, 'value')} {status['value_unit']}"
    promised = "value to go" if status["value_unit"] == "s" else "evader's distance from its target"
    yield "ideal game", f"winner {game['winner']}; {promised} {value}"
    needs = f"needs {_number(game, 'time_needed_s')} s, reaches {_number(game, 'reachable_speed_m_s')} m/s"
    yield "this vehicle", f"winner {game.get('vehicle_winner', 'undecided')}; {needs}"
    if game.get("active_limits"):
        yield "limited by", ", ".join(game["active_limits"])


def _to_do(status: Status) -> Iterator[Text]:
    for row in status.get("to_do", ()):
        style = "bold red" if row["verdict"] == "refuse" else "yellow"
        wanted = f", wanted {row['wanted']}" if row["wanted"] else ""
        advice = f": {row['advice']}" if row["advice"] else ""
        yield Text(f"{row['verdict']:6}  {row['name']} is {row['found']}{wanted}{advice}", style)


def _tenths(value: float) -> str:
    return f"{round(value, 1) + 0.0:.1f}"  # no -0.0


def _age(status: Status, key: str) -> str:
    age_s = status.get(key)
    return "never" if age_s is None else f"{age_s:.1f} s ago"


def _number(game: Status, key: str) -> str:
    value = game.get(key)
    return "-" if value is None else f"{value:.1f}"


def watch(
    there: Console, ask: Callable[[], Status], sleep: Callable[[float], None] = time.sleep, *, times: int | None = None
) -> None:
    """Show a status once a second until Ctrl-C; without a terminal, one below the other.

    Args:
        there: The console.
        ask: Returns the daemon's status.
        sleep: Waits, s.
        times: How often; None for ever.

    Raises:
        LinkError: If the daemon stops answering.
    """
    count = 0
    with Live(console=there, auto_refresh=False, transient=False) as live:
        while times is None or count < times:
            table = status_table(ask())
            if redraws(there):
                live.update(table, refresh=True)
            else:
                there.print(table)
                there.print("")
            count += 1
            sleep(WATCH_S)
