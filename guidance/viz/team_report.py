"""The merged report of a team flight: one page about the records of its vehicles."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from guidance.errors import ConfigError
from guidance.flight import Event
from guidance.flight.settings import TeamSection
from guidance.flight.table import SETPOINT_STATES
from guidance.frames import Vector
from guidance.log import Comparison, SettingsOf, compare
from guidance.log.entries import ASSIGNED
from guidance.log.scene import circle, fence_edges
from guidance.messages import Role
from guidance.session.result import least_distance_m
from guidance.team.messages import Promise, RolesMessage
from guidance.viz import figures
from guidance.viz.figures import EVADER, PURSUER, STANDOFF, TARGET
from guidance.viz.report import write_page
from guidance.viz.story import Rows, Story, story_of


class Capture(NamedTuple):
    """The capture of an evader: by whom, when, and its place in the game frame."""

    vehicle: str
    now_s: float
    place_m: Vector


class TeamStory(NamedTuple):
    """The flights of a team.

    Attributes:
        flights: By vehicle.
        replays: Of each record, with the present code.
        promised: By evader, when the last vehicle engaged; with the cause that was known in the end.
        captures: By evader.
        began_s: When the last vehicle engaged; infinite if one never did.
    """

    flights: Mapping[str, Story]
    replays: Mapping[str, Comparison]
    promised: Mapping[str, Promise]
    captures: Mapping[str, Capture]
    began_s: float

    @property
    def first(self) -> Story:
        """The flight of the first vehicle; game and target are those of all."""
        return next(iter(self.flights.values()))

    @property
    def evaders(self) -> list[str]:
        """The names of the evaders."""
        return sorted({name for flight in self.flights.values() for name in flight.evaders})

    def verdict(self, evader: str) -> str:
        """Say what was promised about an evader, what came of it, and why."""
        promise, capture, cycle = self.promised.get(evader), self.captures.get(evader), self.first.settings.cycle
        achieved, ended, unit = math.nan, "not captured", "s" if cycle.target_game_m is None else "m"
        if capture is not None:
            achieved = capture.now_s - self.began_s
            ended = f"captured by {capture.vehicle} after {achieved:.1f} s"
            if cycle.target_game_m is not None:
                achieved = cycle.target_extent.distance_m(cycle.target_game_m, capture.place_m)
                ended += f", {achieved:.1f} m from the target"
        if promise is None or promise.value is None:
            return f"no capture could be promised; {ended}"
        by = " and ".join(filter(None, (promise.first, promise.second)))
        kept = promise.verdict(promise.value, achieved, unit, captured=capture is not None)
        why = f" ({promise.cause})" if promise.cause and promise.cause not in kept else ""
        return (
            f"{promise.value:.1f} {'m from the target' if unit == 'm' else 's'} promised by {by}; {ended}; {kept}{why}"
        )


def team_story(records: Mapping[str, Path], settings_of: SettingsOf) -> TeamStory:
    """Read the records of a team, by vehicle, and replay them.

    Raises:
        ConfigError: If a record cannot be read, or is not of a team.
    """
    flights = {name: story_of(path, settings_of) for name, path in records.items()}
    captures, told = dict[str, Capture](), list[tuple[float, RolesMessage]]()
    for name, flight in flights.items():
        if flight.settings.team is None:
            raise ConfigError(f"{records[name]}: is not of a team flight; give that file for a report of its own")
        for event in flight.events:
            if event.event == ASSIGNED:
                told.append((event.now_s, RolesMessage.model_validate_json(event.detail)))
            elif event.event == Event.CAPTURED:
                evader = next(role.evader for now_s, role in reversed(_roles(flight)) if now_s <= event.now_s)
                place = next(place for now_s, place in reversed(flight.evaders[evader]) if now_s <= event.now_s)
                captures.setdefault(evader, Capture(name, event.now_s, place))
    told.sort(key=lambda one: (one[0], one[1].term, one[1].seq))
    began_s = max(math.inf if one.engaged is None else one.engaged.now_s for one in flights.values())
    offered = [roles.promises for now_s, roles in told if now_s <= began_s]
    causes = {one.evader: one.cause for _, roles in told for one in roles.promises}
    return TeamStory(
        flights,
        {name: compare(path, settings_of)[0] for name, path in records.items()},
        {one.evader: one.model_copy(update={"cause": causes[one.evader]}) for ones in offered[-1:] for one in ones},
        captures,
        began_s,
    )


def _roles(flight: Story) -> list[tuple[float, Role]]:
    """Return when a vehicle began to play which role."""
    return [(row.now_s, row.inputs.role) for row in flight.rows if row.inputs.role is not None]


def write_team_report(records: Mapping[str, Path], folder: Path, settings_of: SettingsOf) -> list[Path]:
    """Write one report of the records of a team, by vehicle; return the files, the page first.

    Raises:
        ConfigError: If a record cannot be read, or is not of a team.
        OutputError: If the folder cannot be written, or contains the report of other records.
    """
    team = team_story(records, settings_of)
    named = [(path, team.flights[name]) for name, path in records.items()]
    return write_page(folder, named, team, {"plan": plan}, opening(team), rows_of(team))


def opening(team: TeamStory) -> str:
    """Return the first paragraph: who flew, what was promised and kept, the least distance, alarms and replay."""
    flights, wanted = team.flights.values(), team.first.settings.team or TeamSection()
    given = [name for name, one in team.promised.items() if one.value is not None]
    kept = sum("; kept" in team.verdict(name) for name in given)
    flown = [zip(one.rows, one.cycles, strict=True) for one in flights]
    tracks = [{row.now_s: cycle.pursuer_m for row, cycle in one if row.state in SETPOINT_STATES} for one in flown]
    least_m = least_distance_m(tracks, wanted.separation_height_m)
    apart = "never flew at one height" if math.isinf(least_m) else f"stayed {least_m:.1f} m apart"
    alarms = sum(len(one.alarms) for one in flights)
    differing = [name for name, one in team.replays.items() if one.differing]
    replayed = f"{', '.join(differing)} replays differently" if differing else "every vehicle replays bit for bit"
    return (
        f"{team.first.title}: {', '.join(team.flights)} flew for {max(one.lasted_s for one in flights):.0f} s against "
        f"{', '.join(team.evaders)}. At engagement the team promised {len(given)} captures; {kept} promises were kept, "
        f"and {len(team.captures)} of {len(team.evaders)} evaders were captured. Vehicles less than "
        f"{wanted.separation_height_m:g} m apart in height {apart} ({wanted.separation_m:g} m wanted). "
        f"{alarms or 'No'} alarm{'' if alarms == 1 else 's'}; {replayed}, with its mates and assignments."
    )


def rows_of(team: TeamStory) -> Rows:
    """Return a row for each player."""
    rows = []
    for name, flight in team.flights.items():
        against = ", then ".join(
            f"{role.evader} {f'({role.above_m:g} m above) ' if role.above_m else ''}from {now_s:.1f} s"
            for now_s, role in _roles(flight)
        )
        captured = [f"captured {evader}" for evader, one in team.captures.items() if one.vehicle == name]
        replayed = team.replays[name]
        same = f"except in {replayed.differing} cycles" if replayed.differing else "bit for bit"
        ended = f"ended {flight.rows[-1].state}", f"{len(flight.alarms)} alarms"
        words = f"against {against}", *captured, *ended, f"{replayed.setpoints} setpoints replay {same}"
        rows.append((name, "; ".join(words)))
    return [*rows, *((name, team.verdict(name)) for name in team.evaders)]


def plan(team: TeamStory) -> Figure:
    """Draw all vehicles and evaders from above."""
    figure = figures.figure_of(10.0, 7.5)
    axes: Any = figure.subplots()
    cycle, flight = team.first.settings.cycle, team.first.flight
    vehicles = {name: story.column("pursuer_m") for name, story in team.flights.items()}
    evaders = {
        name: np.array([place for one in team.flights.values() for _, place in one.evaders.get(name, ())])
        for name in team.evaders
    }
    # reports of one evader to several vehicles are dots: joined, they would go to and fro
    dots = EVADER | {"linestyle": "none", "marker": ".", "markersize": 2}
    for tracks, style, kind in ((vehicles, PURSUER, "vehicle"), (evaders, dots, "evader")):
        for name, track in tracks.items():
            known = figures.thinned(track[np.isfinite(track).all(axis=1)])
            axes.plot(*known[:, :2].T, **style, label=kind)
            axes.annotate(name, known[0, :2], xytext=(6, -4), textcoords="offset points", color=style["color"])
    for capture in team.captures.values():
        axes.plot(*circle(capture.place_m, cycle.standoff.radius_m).T, **STANDOFF, label="stand-off disc at capture")
    if cycle.target_game_m is not None:
        figures.draw_place(axes, cycle.target_game_m, TARGET, 2, "target")
    figures.label_plan(axes)
    axes.margins(0.1)
    axes.set(xlim=axes.get_xlim(), ylim=axes.get_ylim())
    figures.draw_fence(axes, [] if flight.home_m is None else fence_edges(flight.envelope, flight.home_m), 0.0, 2)
    figures.legend_below(figure, axes, columns=4)
    return figure
