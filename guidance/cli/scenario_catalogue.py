"""Output of `guidance scenario list` and `show`: the bundled scenarios."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from guidance.config import config_folder
from guidance.extras import require
from guidance.screen import pairs, sheet
from guidance.sim.expect import Expectations
from guidance.sim.maths import opening
from guidance.sim.outcome import winner_name
from guidance.sim.scenario import Player, Scenario
from guidance.sim.scenario_file import FOLDER, load_any
from guidance.sim.team_maths import opening_of
from guidance.sim.teams import TeamScenario

_WIDE: Final = 120


def names() -> list[str]:
    """Return the names of the bundled scenarios."""
    return sorted(path.stem for path in (config_folder() / FOLDER).glob("*.toml"))


def listed() -> list[dict[str, str]]:
    """Return the rows of `guidance scenario list`: name, game, title and expectations.

    Raises:
        ConfigError: If one of the files is wrong.
    """
    rows = []
    for name in names():
        scenario = load_any(name)[1]
        said = team_expected(scenario) if isinstance(scenario, TeamScenario) else expected(scenario)
        rows.append({"name": name, "game": scenario.game, "title": scenario.title, "expected": said})
    return rows


def listing(width: int) -> Table:
    """Return the table of `guidance scenario list`; expectations are shown from 120 columns on.

    Raises:
        ConfigError: If one of the files is wrong.
    """
    shown = ("name", "game", "title", "expected")[: 4 if width >= _WIDE else 3]
    rows = [[row[column] for column in shown] for row in listed()]
    others = sum(
        max(map(len, (heading, *column))) + 2 for heading, *column in list(zip(shown, *rows, strict=True))[:-1]
    )
    room = max(8, width - others)
    cut = [[*row, last if len(last) <= room else f"{last[: room - 1]}…"] for *row, last in rows]
    return sheet(shown, cut, left=range(4))


def show(name: str, console: Console, picture: Path | None) -> None:
    """Explain a scenario, and draw it into `picture` if given.

    Raises:
        ConfigError: If there is no such scenario, a key in it is wrong, or the picture's format is unknown.
        OutputError: If the picture cannot be written.
    """
    if picture is not None:
        require(f"--out {picture}", "plot")
        from guidance.viz.figures import check_picture  # noqa: PLC0415 - slow import

        check_picture(picture)
    path, scenario = load_any(name)
    console.print(f"[bold]{scenario.title}[/bold]  ({path.name})")
    console.print(" ".join(scenario.description.split()))
    console.print()
    console.print(pairs(_facts(scenario)))
    if picture is not None:
        _draw(scenario, picture)
        console.print(f"picture  {picture}", soft_wrap=True, highlight=False)


def explained(name: str) -> dict[str, Any]:
    """Return the content of `show` as plain values.

    Raises:
        ConfigError: If there is no such scenario, or a key in it is wrong.
    """
    path, scenario = load_any(name)
    said: dict[str, list[str]] = {}
    for fact, words in _facts(scenario):
        said.setdefault(fact, []).append(words)
    about = " ".join(scenario.description.split())
    return {"file": path.name, "title": scenario.title, "description": about, "facts": said}


def _facts(scenario: Scenario | TeamScenario) -> Iterator[tuple[str, str]]:
    return team_facts(scenario) if isinstance(scenario, TeamScenario) else facts(scenario)


def _draw(scenario: Scenario | TeamScenario, path: Path) -> None:
    from guidance.viz.scenario_picture import draw_scenario  # noqa: PLC0415 - slow import
    from guidance.viz.team_picture import draw_teams  # noqa: PLC0415

    if isinstance(scenario, TeamScenario):
        draw_teams(scenario, path)
    else:
        draw_scenario(scenario, path)


def facts(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the facts of a scenario by name."""
    pursuer, evader, disc = scenario.pursuer, scenario.evader, scenario.standoff
    speeds = f"{pursuer.speed_m_s:g} m/s"
    if pursuer.speed_set == "cylinder":
        speeds += f" level, {pursuer.climb_m_s:g} up, {pursuer.descent_m_s:g} down"
    yield "game", {"pe": "pursuit-evasion", "tad": "target-attacker-defender"}[scenario.game]
    yield "pursuer", f"at {_place(pursuer.position_m)} m, {speeds} ({pursuer.speed_set}), {_plays(pursuer)}"
    declared = "" if evader.declared_speed_m_s is None else f" (declares {evader.declared_speed_m_s:g})"
    yield "evader", f"at {_place(evader.position_m)} m, {evader.speed_m_s:g} m/s{declared}, {_plays(evader)}"
    if scenario.target is not None:
        yield "target", f"at {_place(scenario.target.position_m)} m"
    yield "captured", f"within {disc.tolerance_m:g} m of the disc of {disc.radius_m:g} m, {disc.height_m:g} m up"
    yield "value", _value(scenario)
    if set(scenario.sensor.model_fields_set):
        yield "sensor", ", ".join(f"{key} = {value}" for key, value in scenario.sensor if value)
    if any(scenario.wind.velocity_m_s):
        yield "wind", f"{_place(scenario.wind.velocity_m_s)} m/s, east and north"
    for fault in scenario.fault:
        keys = "".join(f", {key} = {value}" for key, value in fault.keys().items())
        since = "engagement" if fault.after == "engaged" else "the start"
        yield "fault", f"{fault.kind} of the {fault.vehicle} {fault.at_s:g} s after {since}{keys}"
    yield "expected", expected(scenario) or "nothing"


def team_facts(scenario: TeamScenario) -> Iterator[tuple[str, str]]:
    """Yield the facts of a team scenario by name."""
    yield "game", {"pe": "pursuit-evasion", "tad": "target-attacker-defender"}[scenario.game] + ", of teams"
    for player, groups in (("pursuers", scenario.pursuer), ("evaders", scenario.evader)):
        for group in groups:
            about = f", scattered over {group.scatter_m:g} m" if group.scatter_m else ""
            place = _place(group.position_m)
            yield player, f"{group.count} at {place} m{about}, {group.speed_m_s:g} m/s, plays {group.policy}"
    if scenario.target is not None:
        yield "target", f"at {_place(scenario.target.position_m)} m"
    first = opening_of(scenario)
    unit = "m from the target" if scenario.game == "tad" else "s until the captures"
    yield "value", f"{int(first.guaranteed)} captures guaranteed, {float(first.total):.2f} {unit} in all"
    yield "expected", team_expected(scenario) or "nothing"


def team_expected(scenario: TeamScenario) -> str:
    """Return the expectations of a team scenario in one line."""
    wanted = ((column, getattr(scenario.expect, column)) for column in type(scenario.expect).model_fields)
    return ", ".join(f"{column} {value}" for column, value in wanted if value is not None)


def expected(scenario: Scenario) -> str:
    """Return the expectations of a scenario in one line."""
    parts = [*_said(scenario.expect)]
    for run in ("maths", "flown"):
        said = ", ".join(_said(getattr(scenario.expect, run)))
        parts += [f"{run}: {said}"] if said else []
    return "; ".join(parts)


def _said(expectations: Expectations) -> Iterator[str]:
    for column in Expectations.model_fields:
        value = getattr(expectations, column)
        if column == "events":
            yield from (f"has {event!r}" for event in value)
        elif value is not None:
            yield str(value) if column in {"end", "winner"} else f"{column} {value}"


def _value(scenario: Scenario) -> str:
    first = opening([scenario])
    value, winner = float(first.value[0]), winner_name(int(first.winner[0]))
    if winner == "evader":
        return f"the evader wins: the pursuer misses by {value:.2f} m"
    return f"{value:.2f} s to capture" if scenario.game == "pe" else f"{value:.2f} m from the target, {winner} wins"


def _plays(player: Player) -> str:
    return f"plays {player.policy}"


def _place(place: tuple[float, ...]) -> str:
    return f"({', '.join(f'{part:g}' for part in place)})"
