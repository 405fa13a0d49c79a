"""Reads records into arrays over the cycles of their flights, and sums them up in words and a table. NaN is unknown.

A history is of one flight, or of the flights of a team.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
from guidance.game.arrays import FloatArray
from guidance.log import Aggregator, Comparison, Cycle, Survey, compare, metadata_of, scan, title_of
from guidance.log.entries import ASSIGNED, EVENT, CycleEntry, EventEntry
from guidance.messages import Home, Role
from guidance.session.flight_files import recorded_settings
from guidance.session.fly.result import Capture, distance_to_target_m, least_distance_m, predicted
from guidance.team.messages import Promise, RolesMessage

TableRow = tuple[str, str]
"""Name and value of a line of a table."""


class GameCycle(NamedTuple):
    """A cycle of the game: its number in the flight, and its certificate."""

    number: int
    now_s: float
    certificate: Certificate


class FlightHistory(NamedTuple):
    """A flight, cycle by cycle.

    Attributes:
        path: Of the record.
        title: Of the flight.
        survey: Of the record.
        settings: At the start.
        flight: The flight's data after the last cycle: home, limits.
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
    game: list[GameCycle]
    evaders: dict[str, list[tuple[float, Enu]]]

    def column(self, name: str) -> FloatArray:
        """Return one field of all cycles, shape (n,) or (n, 3)."""
        return np.array([getattr(cycle, name) for cycle in self.cycles])

    @property
    def engaged(self) -> GameCycle | None:
        """The first cycle of the game."""
        return self.game[0] if self.game else None

    @property
    def captured(self) -> GameCycle | None:
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
        engaged_s = first_s.get(State.ENGAGED, math.nan)
        on_station_s = first_s.get(State.ON_STATION, math.nan)
        return on_station_s - engaged_s


def history_of(path: Path) -> FlightHistory:
    """Read a record into arrays.

    Raises:
        ConfigError: If it cannot be read, or holds no cycle.
    """
    metadata = metadata_of(path)
    survey = Survey()
    flight = Aggregator(recorded_settings, metadata, str(path))
    history = FlightHistory(
        path, title_of(metadata), survey, flight.settings, flight, [], [], [], [], {}
    )
    for item in scan(path, survey):
        entry = flight.take(item)
        if isinstance(entry, EventEntry):
            history.events.append(entry)
        elif entry is not None:
            if entry.certificate is not None:
                number = len(history.rows)
                history.game.append(GameCycle(number, entry.now_s, entry.certificate))
            history.rows.append(entry)
            history.cycles.append(flight.cycle)
            reported = {
                "" if report.evader is None else report.evader for report in entry.inputs.reports
            }
            for name in reported & flight.evaders_m.keys():
                track = history.evaders.setdefault(name, [])
                track.append((entry.now_s, flight.evaders_m[name]))
    if not history.cycles:
        raise ConfigError(f"{path}: contains no guidance cycle, so there is nothing to report")
    return history


def opening_words(history: FlightHistory) -> str:
    """Return the report's first paragraph: vehicle, time and place, promise, outcome, limits."""
    started = history.survey.metadata.get("started_utc", "")
    home = history.flight.vehicle.latest.get(Home)
    when = "in virtual time"
    if started:
        date = started[:10]
        minute = started[11:16]
        when = f"on {date} at {minute} UTC"
    home_words = ""
    if home is not None:
        home_words = f" from {home.latitude_deg:.5f}°, {home.longitude_deg:.5f}°"
    vehicle = f"{history.title} ({history.settings.autopilot.name})"
    opening_sentence = f"{vehicle} flew {when}{home_words} for {history.lasted_s:.0f} s."
    sentences = (
        opening_sentence,
        _promise_sentence(history),
        _happened(history),
        _limits_sentence(history),
    )
    return " ".join(filter(None, sentences))


def _promise_sentence(history: FlightHistory) -> str:
    """Return the vehicle's promise at engagement."""
    if history.engaged is None:
        return ""
    engaged = history.engaged.certificate
    standoff = history.settings.cycle.game.standoff
    if engaged.no_game:
        return "At engagement nothing could be promised: the evader was too fast."
    if history.with_target and not engaged.assured_distance_m >= 0.0:
        return "At engagement it could not promise to keep the evader from its target."
    time_words = "without a time"
    if math.isfinite(engaged.time_needed_s):
        time_words = f"within {engaged.time_needed_s:.1f} s"
    if history.with_target:
        condition = f", at least {engaged.assured_distance_m:.1f} m from the target"
    else:
        condition = " if the evader runs away from it"
    disc = f"{standoff.radius_m:g} m beside and {standoff.height_m:g} m above the evader"
    return f"At engagement it promised to be {disc} {time_words}{condition}."


def _happened(history: FlightHistory) -> str:
    """Say how the game and the flight ended."""
    ending = f"the flight ended {history.rows[-1].state}"
    if history.engaged is None:
        return f"No game was played; {ending}."
    if history.captured is None:
        return f"It did not reach that place; {ending}."
    lasted_s = history.game_lasted_s
    needed_s = history.engaged.certificate.time_needed_s
    share_words = ""
    if needed_s > 0.0:
        share = lasted_s / needed_s
        share_words = f" ({share:.2f} of the promise)"
    distance_words = ""
    if history.with_target:
        away_m = _achieved_value(history, history.captured)
        distance_words = f", with the evader {away_m:.1f} m from the target"
    return f"It was there after {lasted_s:.1f} s{share_words}{distance_words}; {ending}."


def _limits_sentence(history: FlightHistory) -> str:
    """Say which limits changed the commands, and whether a promise was broken."""
    acting = Counter[str]()
    for row in history.game:
        acting.update(row.certificate.active_limits)
    cycles = len(history.game)
    often = [
        f"{name} ({count / cycles:.0%} of the game)"
        for name, count in acting.most_common(3)
        if count >= 0.01 * cycles
    ]
    limits = "No limit changed its commands."
    if often:
        limits = f"Limits that changed its commands: {', '.join(often)}."
    slowest_m_s = _slowest_m_s(history)
    speed_words = ""
    if not math.isnan(slowest_m_s):
        speed_words = f" It was seen to reach at least {slowest_m_s:.1f} m/s."
    counts = Counter(alarm for _, alarm in history.alarms)
    alarms = "There was no alarm."
    if counts:
        kinds = ", ".join(f"{kind} ({count})" for kind, count in counts.items())
        alarms = f"Alarms: {kinds}."
    return f"{limits}{speed_words} {alarms}"


def summary(history: FlightHistory) -> Iterator[TableRow]:
    """Yield the rows of the summary table."""
    yield from _game_rows(history)
    survey = history.survey
    speeds_m_s = np.linalg.norm(history.column("flown_ned_m_s"), axis=-1)
    highest_m_s = _finite_extreme(max, speeds_m_s)
    states = [row.state for row in history.rows]
    is_playing = np.isin(states, [State.ENGAGED, State.PAUSED, State.ON_STATION])
    heights_m = history.column("pursuer_m")[is_playing, 2]
    lowest_m = _finite_extreme(min, heights_m)
    commanded_north_m_s = history.column("commanded_ned_m_s")[:, 0]
    setpoints = np.count_nonzero(np.isfinite(commanded_north_m_s))
    condition = ", ".join(survey.faults) if survey.faults else "whole"
    versions = [
        f"{name} {text}"
        for name, text in survey.metadata.items()
        if name not in {"scenario", "config", "seed"}
    ]
    yield "record lasts", f"{history.lasted_s:.1f} s, {len(history.cycles)} cycles"
    yield "setpoints sent", f"{setpoints}"
    yield "highest speed", f"{highest_m_s:.2f} m/s"
    yield "lowest height during the game", f"{lowest_m:.2f} m above the evader's plane"
    yield "guarantee alarms", f"{len(history.alarms)}"
    yield "age of the vehicle's position", _spread_ms(history.column("telemetry_age_s"))
    yield "age of the evader's last report", _spread_ms(history.column("evader_age_s"))
    yield "delay of cycles", _spread_ms(history.column("late_s"))
    yield "working time of cycles", _spread_ms(history.column("worked_s"))
    yield "events", f"{survey.messages[EVENT.topic]}"
    yield "record", f"{condition}, {survey.messages.total()} messages"
    yield "seed", survey.metadata.get("seed", "–")
    yield "made by", ", ".join(versions)


def _game_rows(history: FlightHistory) -> Iterator[TableRow]:
    cycle = history.settings.cycle
    unit = "m from T" if history.with_target else "s"
    disc = cycle.game.standoff
    standoff = f"{disc.radius_m:g} m around, {disc.height_m:g} m above the evader's plane"
    outcome = "no game was played"
    if history.captured is not None:
        outcome = "captured"
    elif history.engaged is not None:
        outcome = "not captured"
    last_state = history.rows[-1].state
    yield "outcome", f"{outcome}; ended {last_state}"
    yield "game", "target-attacker-defender" if history.with_target else "pursuit-evasion"
    yield "policy", cycle.policy.name
    yield "autopilot", history.settings.autopilot.name
    yield "stand-off", standoff
    if history.engaged is None:
        return
    engaged = history.engaged.certificate
    value = float(predicted(cycle, engaged).value)
    yield "value predicted at engagement", f"{value:.2f} {unit}"
    yield "time this vehicle needs, at engagement", f"{engaged.time_needed_s:.2f} s"
    yield "speed this vehicle reaches, slowest", f"{_slowest_m_s(history):.1f} m/s"
    if history.with_target:
        yield "distance from T that it can promise", f"{engaged.assured_distance_m:.2f} m"
    if history.captured is not None:
        flown_path = _achieved_value(history, history.captured)
        lasted_s = history.game_lasted_s
        yield "flown", f"{flown_path:.2f} {unit}"
        yield "flown / predicted", _ratio(flown_path, value)
        yield "game lasted", f"{lasted_s:.2f} s"
        yield "lasted / time needed", _ratio(lasted_s, engaged.time_needed_s)


def _ratio(value: float, reference: float) -> str:
    return f"{value / reference:.3f}" if reference else "–"


def _finite_extreme(choose: Callable[..., float], values: Iterable[float]) -> float:
    """Return the smallest or largest finite value; NaN if there is none."""
    finite_values = filter(math.isfinite, values)
    return choose(finite_values, default=math.nan)


def _slowest_m_s(history: FlightHistory) -> float:
    """Return the smallest speed that the vehicle was seen to reach; NaN in records that do not tell."""
    speeds_m_s = [row.certificate.reachable_speed_m_s for row in history.game]
    return min(filterfalse(math.isnan, speeds_m_s), default=math.nan)


def _achieved_value(history: FlightHistory, captured: GameCycle) -> float:
    cycle = history.settings.cycle
    if cycle.target_game_m is None:
        return history.game_lasted_s
    return distance_to_target_m(cycle, captured.certificate.evader_game_m)


def _spread_ms(values: FloatArray) -> str:
    finite_ms = 1e3 * values[np.isfinite(values)]
    if not len(finite_ms):
        return "not recorded"
    median_ms, p99_ms, largest_ms = np.percentile(finite_ms, (50, 99, 100))
    return f"median {median_ms:.1f} ms, p99 {p99_ms:.1f} ms, largest {largest_ms:.1f} ms"


class TeamHistory(NamedTuple):
    """The flights of a team.

    Attributes:
        flights: By vehicle.
        replays: Of each record, with the present code.
        promised: By evader, when the last vehicle engaged; with the cause that was known in the end.
        captures: By evader.
        began_s: When the last vehicle engaged; infinite if one never did.
    """

    flights: Mapping[str, FlightHistory]
    replays: Mapping[str, Comparison]
    promised: Mapping[str, Promise]
    captures: Mapping[str, Capture]
    began_s: float

    @property
    def first(self) -> FlightHistory:
        """The flight of the first vehicle; game and target are those of all."""
        return next(iter(self.flights.values()))

    @property
    def evaders(self) -> list[str]:
        """The names of the evaders."""
        names = set[str]()
        for flight in self.flights.values():
            names |= flight.evaders.keys()
        return sorted(names)

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
        pursuers = " and ".join(filter(None, (promise.first, promise.second)))
        verdict = promise.verdict(promise.value, achieved, unit, captured=capture is not None)
        cause = ""
        if promise.cause and promise.cause not in verdict:
            cause = f" ({promise.cause})"
        unit_words = "m from the target" if unit == "m" else "s"
        promise_words = f"{promise.value:.1f} {unit_words} promised by {pursuers}"
        return f"{promise_words}; {ending}; {verdict}{cause}"


def team_history(records: Mapping[str, Path]) -> TeamHistory:
    """Read the records of a team, by vehicle, and replay them.

    Raises:
        ConfigError: If a record cannot be read, or is not of a team.
    """
    flights = {name: history_of(path) for name, path in records.items()}
    for name, flight in flights.items():
        if flight.settings.team is None:
            raise ConfigError(
                f"{records[name]}: is not of a team flight; give that file for a report of its own"
            )
    captures = captures_of(flights)
    engaged_s = [
        math.inf if flight.engaged is None else flight.engaged.now_s for flight in flights.values()
    ]
    began_s = max(engaged_s)
    # Which roles and promises were announced, and when, in their order.
    announcements = list[tuple[float, RolesMessage]]()
    for flight in flights.values():
        for event in flight.events:
            if event.event == ASSIGNED:
                roles = RolesMessage.model_validate_json(event.detail)
                announcements.append((event.now_s, roles))
    announcements.sort(
        key=lambda announcement: (announcement[0], announcement[1].term, announcement[1].seq)
    )
    # The last promises up to that time, by evader, each with the cause that was announced last.
    promises: Sequence[Promise] = ()
    causes = dict[str, str]()
    for now_s, roles in announcements:
        if now_s <= began_s:
            promises = roles.promises
        for promise in roles.promises:
            causes[promise.evader] = promise.cause
    promised = dict[str, Promise]()
    for promise in promises:
        last_cause = causes[promise.evader]
        promised[promise.evader] = promise.model_copy(update={"cause": last_cause})
    replays = {name: compare(path, recorded_settings)[0] for name, path in records.items()}
    return TeamHistory(flights, replays, promised, captures, began_s)


def captures_of(flights: Mapping[str, FlightHistory]) -> dict[str, Capture]:
    """Return the first capture of each evader, from the flights of all vehicles."""
    captures = dict[str, Capture]()
    for name, flight in flights.items():
        for event in flight.events:
            if event.event != Event.CAPTURED:
                continue
            until_s = event.now_s
            roles = [role for now_s, role in _roles(flight) if now_s <= until_s]
            cycles = [cycle for cycle in flight.game if cycle.now_s <= until_s]
            evader = roles[-1].evader
            certificate = cycles[-1].certificate
            capture = Capture(name, until_s, certificate.evader_game_m)
            if evader not in captures or capture.now_s < captures[evader].now_s:
                captures[evader] = capture
    return captures


def _roles(flight: FlightHistory) -> list[tuple[float, Role]]:
    """Return when a vehicle began to play which role."""
    return [(row.now_s, row.inputs.role) for row in flight.rows if row.inputs.role is not None]


def team_opening_words(team: TeamHistory) -> str:
    """Return the first paragraph: vehicles, promises and how many were kept, the least distance, alarms and replay."""
    flights = team.flights.values()
    separation = team.first.settings.team
    if separation is None:
        separation = TeamSection()
    promised = [name for name, promise in team.promised.items() if promise.value is not None]
    kept_count = sum("; kept" in team.verdict(name) for name in promised)
    lasted_s = max(flight.lasted_s for flight in flights)
    vehicles = ", ".join(team.flights)
    evaders = ", ".join(team.evaders)
    captures = f"{len(team.captures)} of {len(team.evaders)} evaders were captured"
    differing = [name for name, comparison in team.replays.items() if comparison.differing]
    if differing:
        replay_words = f"{', '.join(differing)} replays differently"
    else:
        replay_words = "every vehicle replays bit for bit"
    # Least distance between vehicles at about one height.
    tracks = []
    for flight in team.flights.values():
        samples = zip(flight.rows, flight.cycles, strict=True)
        track = {
            row.now_s: cycle.pursuer_m for row, cycle in samples if row.state in SETPOINT_STATES
        }
        tracks.append(track)
    least_m = least_distance_m(tracks, separation.separation_height_m)
    apart_words = (
        "never flew at one height" if math.isinf(least_m) else f"stayed {least_m:.1f} m apart"
    )
    alarm_count = sum(len(flight.alarms) for flight in team.flights.values())
    alarm_words = f"{alarm_count} alarms"
    if alarm_count < 2:
        alarm_words = "1 alarm" if alarm_count else "No alarms"
    sentences = (
        f"{team.first.title}: {vehicles} flew for {lasted_s:.0f} s against {evaders}.",
        f"At engagement the team promised {len(promised)} captures;",
        f"{kept_count} promises were kept, and {captures}.",
        f"Vehicles less than {separation.separation_height_m:g} m apart in height",
        f"{apart_words} ({separation.separation_m:g} m wanted).",
        f"{alarm_words}; {replay_words}, with its mates and assignments.",
    )
    return " ".join(sentences)


def team_summary(team: TeamHistory) -> Iterator[TableRow]:
    """Yield a row for each player."""
    for name, flight in team.flights.items():
        role_words = []
        for now_s, role in _roles(flight):
            height = ""
            if role.above_m:
                height = f" ({role.above_m:g} m above)"
            role_words.append(f"{role.evader}{height} from {now_s:.1f} s")
        against = ", then ".join(role_words)
        captured = [
            f"captured {evader}"
            for evader, capture in team.captures.items()
            if capture.vehicle == name
        ]
        replayed = team.replays[name]
        same = "bit for bit"
        if replayed.differing:
            same = f"except in {replayed.differing} cycles"
        parts = (
            f"against {against}",
            *captured,
            f"ended {flight.rows[-1].state}",
            f"{len(flight.alarms)} alarms",
            f"{replayed.setpoints} setpoints replay {same}",
        )
        yield name, "; ".join(parts)
    for name in team.evaders:
        yield name, team.verdict(name)
