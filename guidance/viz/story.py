"""Reads records into arrays over the cycles of their flights, and tells them: a paragraph and a table. NaN is unknown.

A story is of one flight, or of the flights of a team.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import filterfalse
from pathlib import Path
from typing import NamedTuple

import numpy as np

from guidance.cycle import Certificate
from guidance.errors import ConfigError
from guidance.flight import Event, FlightSettings, State
from guidance.flight.settings import TeamSection
from guidance.flight.table import SETPOINT_STATES
from guidance.frames import Enu
from guidance.log import Aggregator, Comparison, Cycle, Survey, compare, metadata_of, scan, title_of
from guidance.log.entries import ASSIGNED, EVENT, CycleEntry, EventEntry
from guidance.log.scene import Array
from guidance.messages import Home, Role
from guidance.session.flight_files import recorded_settings
from guidance.session.fly.result import Capture, distance_to_target_m, least_distance_m, predicted
from guidance.team.messages import Promise, RolesMessage

Row = tuple[str, str]
"""Name and value of a line of a table."""


class Played(NamedTuple):
    """A cycle of the game: its number in the flight, and its certificate."""

    number: int
    now_s: float
    certificate: Certificate


class Story(NamedTuple):
    """A flight, cycle by cycle.

    Attributes:
        path: Of the record.
        title: Of the flight.
        survey: Of the record.
        settings: At the start.
        flight: What was known after the last cycle: home, limits.
        events: All events.
        rows: One of each cycle, as recorded.
        cycles: The numbers of each.
        game: Those of the game.
        evaders: Track of each evader by name: time and place in the game frame.
    """

    path: Path
    title: str
    survey: Survey
    settings: FlightSettings
    flight: Aggregator
    events: list[EventEntry]
    rows: list[CycleEntry]
    cycles: list[Cycle]
    game: list[Played]
    evaders: dict[str, list[tuple[float, Enu]]]

    def column(self, name: str) -> Array:
        """Return one field of all cycles, shape (n,) or (n, 3)."""
        return np.array([getattr(cycle, name) for cycle in self.cycles])

    @property
    def engaged(self) -> Played | None:
        """The first cycle of the game."""
        return self.game[0] if self.game else None

    @property
    def captured(self) -> Played | None:
        """The first cycle of the capture."""
        return next((row for row in self.game if row.certificate.captured), None)

    @property
    def alarms(self) -> list[tuple[float, str]]:
        """Time and kind of every alarm."""
        return [(row.now_s, str(row.alarm.violation)) for row in self.rows if row.alarm is not None]

    @property
    def with_target(self) -> bool:
        """True if the evader has a target (TAD)."""
        return self.settings.cycle.target_game_m is not None

    @property
    def lasted_s(self) -> float:
        """Duration of the record."""
        return self.cycles[-1].now_s - self.cycles[0].now_s

    @property
    def game_lasted_s(self) -> float:
        """Time from the state ENGAGED to ON STATION, as in `guidance.session.fly.result`; NaN without one of them."""
        first_s = {row.state: row.now_s for row in reversed(self.rows)}
        return first_s.get(State.ON_STATION, math.nan) - first_s.get(State.ENGAGED, math.nan)


def story_of(path: Path) -> Story:
    """Read a record into arrays.

    Raises:
        ConfigError: If it cannot be read, or holds no cycle.
    """
    metadata = metadata_of(path)
    survey = Survey()
    flight = Aggregator(recorded_settings, metadata, str(path))
    story = Story(path, title_of(metadata), survey, flight.settings, flight, [], [], [], [], {})
    for item in scan(path, survey):
        entry = flight.take(item)
        if isinstance(entry, EventEntry):
            story.events.append(entry)
        elif entry is not None:
            if entry.certificate is not None:
                story.game.append(Played(len(story.rows), entry.now_s, entry.certificate))
            story.rows.append(entry)
            story.cycles.append(flight.cycle)
            for name in {
                report.evader or "" for report in entry.inputs.reports
            } & flight.evaders_m.keys():
                story.evaders.setdefault(name, []).append((entry.now_s, flight.evaders_m[name]))
    if not story.cycles:
        raise ConfigError(f"{path}: contains no guidance cycle, so there is nothing to report")
    return story


def opening(story: Story) -> str:
    """Return the report's first paragraph: vehicle, time and place, promise, outcome, limits."""
    started = story.survey.metadata.get("started_utc", "")
    home = story.flight.vehicle.latest.get(Home)
    when = f"on {started[:10]} at {started[11:16]} UTC" if started else "in virtual time"
    home_words = (
        "" if home is None else f" from {home.latitude_deg:.5f}°, {home.longitude_deg:.5f}°"
    )
    vehicle = f"{story.title} ({story.settings.autopilot.name})"
    opening_sentence = f"{vehicle} flew {when}{home_words} for {story.lasted_s:.0f} s."
    return " ".join(
        filter(None, (opening_sentence, _promise(story), _happened(story), _limited(story)))
    )


def _promise(story: Story) -> str:
    """Return the vehicle's promise at engagement."""
    if story.engaged is None:
        return ""
    engaged = story.engaged.certificate
    standoff = story.settings.cycle.game.standoff
    if engaged.no_game:
        return "At engagement nothing could be promised: the evader was too fast."
    if story.with_target and not engaged.assured_distance_m >= 0.0:
        return "At engagement it could not promise to keep the evader from its target."
    within = (
        f"within {engaged.time_needed_s:.1f} s"
        if math.isfinite(engaged.time_needed_s)
        else "without a time"
    )
    if not story.with_target:
        within += " if the evader runs away from it"
    promise_words = (
        f", at least {engaged.assured_distance_m:.1f} m from the target"
        if story.with_target
        else ""
    )
    disc = f"{standoff.radius_m:g} m beside and {standoff.height_m:g} m above the evader"
    return f"At engagement it promised to be {disc} {within}{promise_words}."


def _happened(story: Story) -> str:
    """Say how the game and the flight ended."""
    ending = f"the flight ended {story.rows[-1].state}"
    if story.engaged is None:
        return f"No game was played; {ending}."
    if story.captured is None:
        return f"It did not reach that place; {ending}."
    lasted_s = story.game_lasted_s
    needed_s = story.engaged.certificate.time_needed_s
    share = f" ({lasted_s / needed_s:.2f} of the promise)" if needed_s > 0.0 else ""
    alarm_words = (
        f", with the evader {_flown(story, story.captured):.1f} m from the target"
        if story.with_target
        else ""
    )
    return f"It was there after {lasted_s:.1f} s{share}{alarm_words}; {ending}."


def _limited(story: Story) -> str:
    """Say which limits changed the commands, and whether a promise was broken."""
    acting = Counter[str]()
    for row in story.game:
        acting.update(row.certificate.active_limits)
    cycles = len(story.game)
    named = ", ".join(
        f"{name} ({count / cycles:.0%} of the game)"
        for name, count in acting.most_common(3)
        if count >= 0.01 * cycles
    )
    limits = (
        f"Limits that changed its commands: {named}." if named else "No limit changed its commands."
    )
    slowest_m_s = _slowest_m_s(story)
    reached = (
        "" if math.isnan(slowest_m_s) else f" It was seen to reach at least {slowest_m_s:.1f} m/s."
    )
    counts = Counter(alarm for _, alarm in story.alarms)
    broken = ", ".join(f"{what} ({count})" for what, count in counts.items())
    return f"{limits}{reached} {f'Alarms: {broken}.' if broken else 'There was no alarm.'}"


def summary(story: Story) -> Iterator[Row]:
    """Yield the rows of the summary table."""
    yield from _game(story)
    survey = story.survey
    speeds = np.linalg.norm(story.column("flown_ned_m_s"), axis=-1)
    playing = np.isin(
        [row.state for row in story.rows], [State.ENGAGED, State.PAUSED, State.ON_STATION]
    )
    lowest_m = min(filter(math.isfinite, story.column("pursuer_m")[playing, 2]), default=math.nan)
    condition = ", ".join(survey.faults) if survey.faults else "whole"
    versions = [
        f"{name} {text}"
        for name, text in survey.metadata.items()
        if name not in {"scenario", "config", "seed"}
    ]
    yield "record lasts", f"{story.lasted_s:.1f} s, {len(story.cycles)} cycles"
    yield "setpoints sent", f"{int(np.isfinite(story.column('commanded_ned_m_s')[:, 0]).sum())}"
    yield "highest speed", f"{max(filter(math.isfinite, speeds), default=math.nan):.2f} m/s"
    yield "lowest height during the game", f"{lowest_m:.2f} m above the evader's plane"
    yield "guarantee alarms", f"{len(story.alarms)}"
    yield "age of the vehicle's position", _spread_ms(story.column("telemetry_age_s"))
    yield "age of the evader's last report", _spread_ms(story.column("evader_age_s"))
    yield "delay of cycles", _spread_ms(story.column("late_s"))
    yield "working time of cycles", _spread_ms(story.column("worked_s"))
    yield "events", f"{survey.messages[EVENT.topic]}"
    yield "record", f"{condition}, {survey.messages.total()} messages"
    yield "seed", survey.metadata.get("seed", "–")
    yield "made by", ", ".join(versions)


def _game(story: Story) -> Iterator[Row]:
    cycle = story.settings.cycle
    unit = "m from T" if story.with_target else "s"
    standoff = f"{cycle.game.standoff.radius_m:g} m around, {cycle.game.standoff.height_m:g} m above the evader's plane"
    outcome = (
        "captured" if story.captured else "not captured" if story.engaged else "no game was played"
    )
    yield "outcome", f"{outcome}; ended {story.rows[-1].state}"
    yield "game", "target-attacker-defender" if story.with_target else "pursuit-evasion"
    yield "policy", cycle.strategy.name
    yield "autopilot", story.settings.autopilot.name
    yield "stand-off", standoff
    if story.engaged is None:
        return
    engaged = story.engaged.certificate
    value = float(predicted(cycle, engaged).value)
    yield "value predicted at engagement", f"{value:.2f} {unit}"
    yield "time this vehicle needs, at engagement", f"{engaged.time_needed_s:.2f} s"
    yield "speed this vehicle reaches, slowest", f"{_slowest_m_s(story):.1f} m/s"
    if story.with_target:
        yield "distance from T that it can promise", f"{engaged.assured_distance_m:.2f} m"
    if story.captured is not None:
        flown_path = _flown(story, story.captured)
        lasted_s = story.game_lasted_s
        yield "flown", f"{flown_path:.2f} {unit}"
        yield "flown / predicted", f"{flown_path / value:.3f}" if value else "–"
        yield "game lasted", f"{lasted_s:.2f} s"
        yield (
            "lasted / time needed",
            f"{lasted_s / engaged.time_needed_s:.3f}" if engaged.time_needed_s else "–",
        )


def _slowest_m_s(story: Story) -> float:
    """Return the smallest speed that the vehicle was seen to reach; NaN in records that do not tell."""
    return min(
        filterfalse(math.isnan, (row.certificate.reachable_speed_m_s for row in story.game)),
        default=math.nan,
    )


def _flown(story: Story, captured: Played) -> float:
    cycle = story.settings.cycle
    if cycle.target_game_m is None:
        return story.game_lasted_s
    return distance_to_target_m(cycle, captured.certificate.evader_game_m)


def _spread_ms(values: Array) -> str:
    finite_ms = 1e3 * values[np.isfinite(values)]
    if not len(finite_ms):
        return "not recorded"
    return "median {:.1f} ms, p99 {:.1f} ms, largest {:.1f} ms".format(
        *np.percentile(finite_ms, (50, 99, 100))
    )


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
        return sorted(set[str]().union(*(flight.evaders for flight in self.flights.values())))

    def verdict(self, evader: str) -> str:
        """Return the promise about an evader, its outcome and the reason."""
        promise = self.promised.get(evader)
        capture = self.captures.get(evader)
        cycle = self.first.settings.cycle
        achieved = math.nan
        ending = "not captured"
        unit = "s" if cycle.target_game_m is None else "m"
        if capture is not None:
            achieved = capture.now_s - self.began_s
            ending = f"captured by {capture.vehicle} after {achieved:.1f} s"
            if cycle.target_game_m is not None:
                achieved = distance_to_target_m(cycle, capture.evader_m)
                ending += f", {achieved:.1f} m from the target"
        if promise is None or promise.value is None:
            return f"no capture could be promised; {ending}"
        by = " and ".join(filter(None, (promise.first, promise.second)))
        verdict = promise.verdict(promise.value, achieved, unit, captured=capture is not None)
        cause = f" ({promise.cause})" if promise.cause and promise.cause not in verdict else ""
        promise_words = (
            f"{promise.value:.1f} {'m from the target' if unit == 'm' else 's'} promised by {by}"
        )
        return f"{promise_words}; {ending}; {verdict}{cause}"


def team_story(records: Mapping[str, Path]) -> TeamStory:
    """Read the records of a team, by vehicle, and replay them.

    Raises:
        ConfigError: If a record cannot be read, or is not of a team.
    """
    flights = {name: story_of(path) for name, path in records.items()}
    announcements = list[tuple[float, RolesMessage]]()
    for name, flight in flights.items():
        if flight.settings.team is None:
            raise ConfigError(
                f"{records[name]}: is not of a team flight; give that file for a report of its own"
            )
        for event in flight.events:
            if event.event == ASSIGNED:
                announcements.append((event.now_s, RolesMessage.model_validate_json(event.detail)))
    captures = captures_of(flights)
    announcements.sort(
        key=lambda announcement: (announcement[0], announcement[1].term, announcement[1].seq)
    )
    began_s = max(
        math.inf if flight.engaged is None else flight.engaged.now_s for flight in flights.values()
    )
    offered = [roles.promises for now_s, roles in announcements if now_s <= began_s]
    causes = dict[str, str]()
    for _, roles in announcements:
        causes |= {promise.evader: promise.cause for promise in roles.promises}
    promised = [
        promise.model_copy(update={"cause": causes[promise.evader]})
        for ones in offered[-1:]
        for promise in ones
    ]
    replays = {name: compare(path, recorded_settings)[0] for name, path in records.items()}
    return TeamStory(
        flights, replays, {promise.evader: promise for promise in promised}, captures, began_s
    )


def captures_of(flights: Mapping[str, Story]) -> dict[str, Capture]:
    """Return the first capture of each evader, from the flights of all vehicles."""
    captures = dict[str, Capture]()
    for name, flight in flights.items():
        for event in flight.events:
            if event.event != Event.CAPTURED:
                continue
            evader = next(
                role.evader for now_s, role in reversed(_roles(flight)) if now_s <= event.now_s
            )
            certificate = next(
                played.certificate
                for played in reversed(flight.game)
                if played.now_s <= event.now_s
            )
            capture = Capture(name, event.now_s, certificate.evader_game_m)
            if evader not in captures or capture.now_s < captures[evader].now_s:
                captures[evader] = capture
    return captures


def _roles(flight: Story) -> list[tuple[float, Role]]:
    """Return when a vehicle began to play which role."""
    return [(row.now_s, row.inputs.role) for row in flight.rows if row.inputs.role is not None]


def team_opening(team: TeamStory) -> str:
    """Return the first paragraph: vehicles, promises and how many were kept, the least distance, alarms and replay."""
    flights = team.flights.values()
    separation = team.first.settings.team or TeamSection()
    promised = [name for name, promise in team.promised.items() if promise.value is not None]
    kept_count = sum("; kept" in team.verdict(name) for name in promised)
    samples = [zip(flight.rows, flight.cycles, strict=True) for flight in flights]
    tracks = [
        {
            row.now_s: cycle.pursuer_m
            for row, cycle in flight_samples
            if row.state in SETPOINT_STATES
        }
        for flight_samples in samples
    ]
    least_m = least_distance_m(tracks, separation.separation_height_m)
    apart = "never flew at one height" if math.isinf(least_m) else f"stayed {least_m:.1f} m apart"
    alarms = sum(len(flight.alarms) for flight in flights)
    differing = [name for name, comparison in team.replays.items() if comparison.differing]
    replayed = (
        f"{', '.join(differing)} replays differently"
        if differing
        else "every vehicle replays bit for bit"
    )
    lasted_s = max(flight.lasted_s for flight in flights)
    return (
        f"{team.first.title}: {', '.join(team.flights)} flew for {lasted_s:.0f} s against "
        f"{', '.join(team.evaders)}. At engagement the team promised {len(promised)} captures; "
        f"{kept_count} promises were kept, and {len(team.captures)} of {len(team.evaders)} evaders "
        "were captured. Vehicles less than "
        f"{separation.separation_height_m:g} m apart in height {apart} ({separation.separation_m:g} m wanted). "
        f"{alarms or 'No'} alarm{'' if alarms == 1 else 's'}; {replayed}, with its mates and assignments."
    )


def team_summary(team: TeamStory) -> Iterator[Row]:
    """Yield a row for each player."""
    for name, flight in team.flights.items():
        heights = {
            role: f" ({role.above_m:g} m above)" if role.above_m else ""
            for _, role in _roles(flight)
        }
        against = ", then ".join(
            f"{role.evader}{heights[role]} from {now_s:.1f} s" for now_s, role in _roles(flight)
        )
        captured = [
            f"captured {evader}"
            for evader, capture in team.captures.items()
            if capture.vehicle == name
        ]
        replayed = team.replays[name]
        same = f"except in {replayed.differing} cycles" if replayed.differing else "bit for bit"
        counted = f"{len(flight.alarms)} alarms", f"{replayed.setpoints} setpoints replay {same}"
        yield (
            name,
            "; ".join(
                (f"against {against}", *captured, f"ended {flight.rows[-1].state}", *counted)
            ),
        )
    yield from ((name, team.verdict(name)) for name in team.evaders)
