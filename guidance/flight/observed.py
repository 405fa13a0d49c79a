"""Everything a flight has received: vehicle, mode, fences, foreign setpoints and evader.

It is updated once per cycle, before any decision.
"""

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from guidance import messages
from guidance.autopilots import Mode
from guidance.control.braking_law import Separation, Situation, measure_walls
from guidance.control.limits import farthest_evader_m
from guidance.cycle import CycleInputs
from guidance.flight.freshness import (
    CHARGE_LIMIT_S,
    FORGOTTEN_S,
    HEIGHT_ERROR_LIMIT_S,
    HOLD_S,
    MATE_SILENT_S,
    TELEMETRY_LIMIT_S,
)
from guidance.flight.settings import FlightSettings, Inputs, TeamSection
from guidance.flight.table import Event
from guidance.flight.tracking import NOWHERE, Tracking
from guidance.frames import Amsl, Enu, GameFrame, LocalFrame, Ned
from guidance.game import StandOff
from guidance.messages import (
    Heartbeat,
    LocalPosition,
    MateState,
    Message,
    PositionTarget,
    Role,
    Setpoint,
)
from guidance.vehicle import LANDED_ON_GROUND, VehicleState, observe

REMEMBERED_S: Final = 1.5
"""Longest time from sending a setpoint to the autopilot's report of it."""

TOLERANCE_M_S: Final = 0.75
STRANGE_REPORTS: Final = 3
"""Number of foreign reports within `WINDOW_S` that show a second source."""

WINDOW_S: Final = 2.0
APART_S: Final = 0.2
"""Foreign reports closer together than this count once: the autopilot's own transients show in several."""

_ROUNDING_S: Final = 1e-6

ORDINARY_AGE_S: Final = 0.1
"""Age of a position that the configured reaction time includes."""

_OLDEST_S: Final = 2.0
"""The reaction time grows no further with an older position. No setpoint uses one of half that age."""

_LATE_STEP_S: Final = 0.05
"""The reaction time follows the age in steps, so that it rests while the delay is steady."""

_LEAST_SHARE: Final = 0.5
"""An autopilot may reduce a setpoint to its speed limits; down to this share it counts as ours."""


AGREEING_REPORTS: Final = 3
"""Number of SYS_STATUS in succession that show a low battery.

A single one is not believed: autopilots send 0 % for a moment when a battery monitor starts or loses its bus.
"""

AGREEING_S: Final = 2.5
"""HEARTBEATs of so long must agree that no other source flies the vehicle: two of their periods.

A single one is not believed: another vehicle, or a program, with the same system id may have sent it.
"""

_SWERVE_M_S2: Final = 5.0

FASTEST_AIRCRAFT_M_S: Final = 60.0
"""Speed of an aircraft whose velocity is unknown."""

SAME_M: Final = 10.0
"""An aircraft reported so near to a mate or an evader, beside its error, is that one."""

MOST_AIRCRAFT: Final = 8
"""The nearest ones."""

AIRCRAFT_NOTE_EVERY_S: Final = 1.0
"""Least time between two notes about new aircraft."""

FARTHEST_AIRCRAFT_M: Final = 5000.0
"""An aircraft farther away is none of ours."""

_AGE_STEP_S: Final = 1.0
"""Ages in ADSB_VEHICLE are whole seconds."""


class Observed:
    """Everything received so far, as it stands in this cycle.

    Attributes:
        vehicle: Last known state of the vehicle.
        tracking: The evader, home, the local frame and the game frame.
        echo: Compares the autopilot's setpoints with ours.
        messages: Messages of this cycle.
        beats: HEARTBEATs of the autopilot in this cycle.
        other_beats: Number of HEARTBEATs with its ids from another autopilot or vehicle type. They change nothing.
        other_beat: The last of them.
        mode: Mode in the last HEARTBEAT.
        armed_in: Modes of the armed vehicle in HEARTBEATs of the last `AGREEING_S`, and the last time of each.
        has_flown: Whether it has left the ground since it was armed.
        foreign: Whether another source commands the vehicle, confirmed by a HEARTBEAT without a pilot's mode.
        position_age_s: Age of its last position in this cycle; infinite before the first one.
        position_ned_m: Position of the vehicle in the local frame.
        moved_ned_m: Movement of that frame in this cycle.
        cycle: Settings of the guidance cycle, with heights and fences about home.
        dt_s: Time since the last cycle.
        seen: Inputs of the guidance in this cycle, once they are computed.
        start_ned_m: Stand-by position, if configured.
        role: In the team; None without one.
        mates: Last state of every other vehicle of the team, by name.
        aircraft: In a team, the last state of other aircraft, by name.
        mode_since_s: Since when HEARTBEAT shows that mode.
        setpoint_timeout_s: How long the autopilot waits for setpoints, as its parameter was last heard.
        notes: Events of this cycle that change no state, with their words: aircraft that came into view, and where
            home is reported instead of where the flight has it.
        battery_needed: Share of the charge below which it returns: on the ground for the whole fence, in flight from
            here.
        charge_s: When the charge was last known; None if it never was.
        charge_is_old: Whether it was known, and is no longer.
        on_ground: Whether a fresh EXTENDED_SYS_STATE says on ground.
        battery_is_low: Whether the charge is below `battery_needed` in the last `AGREEING_REPORTS` SYS_STATUS. An
            unknown charge is not low.
        switched: Whether this cycle began to play against another evader.
    """

    def __init__(self, settings: FlightSettings) -> None:
        self._settings = settings
        self._home_in: tuple[Ned, LocalFrame] | None = None
        self._game_frame: GameFrame | None = None
        self._jumps = (NOWHERE, NOWHERE)
        self._late_s = 0.0
        self.vehicle = VehicleState()
        self.tracking = Tracking(settings)
        self.echo = Echo()
        self.messages: Sequence[Message] = ()
        self.beats: Sequence[Heartbeat] = ()
        self.other_beats = 0
        self.other_beat: Heartbeat | None = None
        self.mode: Mode | None = None
        self.armed_in: dict[Mode, float] = {}
        self.has_flown = False
        self.foreign = False
        self.position_age_s = math.inf
        self.position_ned_m: Ned | None = None
        self.moved_ned_m = NOWHERE
        self.cycle = settings.cycle
        self.dt_s = 0.0
        self.seen: CycleInputs | None = None
        self.start_ned_m: Ned | None = None
        self.mates: dict[str, MateState] = {}
        self.aircraft: dict[str, MateState] = {}
        self.mode_since_s = math.inf
        self.setpoint_timeout_s = settings.autopilot.setpoint_timeout_s
        self.notes: list[tuple[Event, str]] = []
        self._noted_s = -math.inf
        self._no_aircraft_s: dict[str, float] = {}
        self.role: Role | None = None
        self.switched = False
        self._low_battery_reports = 0
        self.battery_is_low = False
        self.charge_s: float | None = None
        self.charge_is_old = False
        self.on_ground = False
        self.battery_needed = settings.battery_minimum
        if settings.reserve is not None:
            self.battery_needed = settings.reserve.needed(
                settings.farthest_m, settings.takeoff_height_m
            )

    def vehicle_says(self, messages: Sequence[Message]) -> None:
        """Update only the vehicle."""
        self.beats = [message for message in messages if isinstance(message, Heartbeat)]
        if self.beats:
            # Count and drop HEARTBEATs that are not the configured autopilot's; `beats` keeps its own.
            speaks = self._settings.autopilot.speaks
            others = [beat for beat in self.beats if not speaks(beat)]
            if others:
                self.other_beats += len(others)
                self.other_beat = others[-1]
                self.beats = [beat for beat in self.beats if speaks(beat)]
                messages = [
                    message
                    for message in messages
                    if not isinstance(message, Heartbeat) or speaks(message)
                ]
        self.messages = messages
        self.vehicle = observe(self.vehicle, messages)
        for beat in self.beats:
            mode = self._settings.autopilot.mode_of(beat.custom_mode)
            if mode is not self.mode:
                self.mode = mode
                self.mode_since_s = beat.received_s
            self.armed_in = {
                mode: armed_s
                for mode, armed_s in self.armed_in.items()
                if beat.received_s - armed_s < AGREEING_S
            }
            if beat.armed:
                self.armed_in[mode] = beat.received_s

    def fix_home(self) -> None:
        """Fix home, and with it the fence and all heights."""
        self.vehicle = self.vehicle._replace(home_fixed=True)

    def take_in(self, now_s: float, inputs: Inputs, dt_s: float = 0.0, *, in_flight: bool) -> None:
        """Update everything with the inputs of one cycle.

        Args:
            now_s: Time of the cycle.
            inputs: Its inputs.
            dt_s: Time since the last one.
            in_flight: Whether jumps of the evader are bounded by the distance it can have covered.
        """
        self.seen = None
        self.dt_s = dt_s
        self.switched = False
        if inputs.mates is not None or inputs.role is not None:
            self._hear_team(inputs)
        self.vehicle_says(inputs.messages)
        self.position_age_s = self.vehicle.age_s(LocalPosition, now_s)
        if self.position_age_s > ORDINARY_AGE_S or self._late_s > 0.0:
            # The vehicle brakes before every wall by its reaction time. Positions that are older than ordinary make
            # it longer: the age counts from the measurement, so the link's delay and the silence since are both in
            # it.
            late_s = _beyond_ordinary(self.position_age_s)
            if late_s != self._late_s:
                self._late_s = late_s
                reaction_s = self._settings.cycle.envelope.reaction_s + late_s
                envelope = replace(self.cycle.envelope, reaction_s=reaction_s)
                self.cycle = replace(self.cycle, envelope=envelope)
        landed = self.vehicle.latest.get(messages.LandedState)
        self.on_ground = (
            landed is not None
            and landed.landed_state == LANDED_ON_GROUND
            and now_s - landed.received_s <= 2.0 * TELEMETRY_LIMIT_S
        )
        self.has_flown = self.vehicle.armed and (self.has_flown or not self.on_ground)
        self.tracking.observe(self.vehicle, inputs.reports, in_flight=in_flight)
        other_home = self.tracking.other_home(self.vehicle)
        self.notes = [(Event.HOME_MOVED, other_home)] if other_home else []
        was_foreign = self.echo.foreign if self.beats else False
        echoes = [message for message in inputs.messages if isinstance(message, PositionTarget)]
        if echoes:
            delay_s = _beyond_ordinary(self.vehicle.delay_s)
            self.echo.hear(echoes, guided=self.mode is Mode.GUIDED, late_s=delay_s)
        # A pilot's takeover shows as foreign setpoints before HEARTBEAT shows it, so wait for the next HEARTBEAT.
        self.foreign = self.echo.foreign if was_foreign else False
        self._place()
        reserve = self._settings.reserve
        position_ned_m = self.position_ned_m
        home = self.tracking.home_ned_m
        if in_flight and reserve is not None and position_ned_m is not None and home is not None:
            self.battery_needed = reserve.needed(
                math.dist(position_ned_m[:2], home[:2]), home[2] - position_ned_m[2]
            )
        has_team = self._settings.team is not None
        for message in self.messages:
            if isinstance(message, messages.SystemStatus):
                if not math.isnan(message.battery_remaining):
                    self.charge_s = message.received_s
                is_low = message.battery_remaining < self.battery_needed
                self._low_battery_reports = self._low_battery_reports + 1 if is_low else 0
                self.battery_is_low = self._low_battery_reports >= AGREEING_REPORTS
            elif isinstance(message, messages.Parameter):
                unit_s = self._settings.autopilot.loss_times.get(message.name)
                if unit_s is not None:
                    self.setpoint_timeout_s = message.value * unit_s
            elif has_team and isinstance(message, messages.Aircraft):
                self._take_aircraft(message)
        self.charge_is_old = self.charge_s is not None and now_s - self.charge_s > CHARGE_LIMIT_S

    def _hear_team(self, inputs: Inputs) -> None:
        """Keep the mates' states, and play against the evader that is assigned, at the assigned height."""
        if inputs.mates is not None:
            self.mates.update((mate.name, mate) for mate in inputs.mates)
        role = inputs.role
        if role is None:
            return
        self.role = role
        self.switched = role.evader != self.tracking.playing
        self.tracking.playing = role.evader
        game = self._settings.cycle.game
        speed_m_s = self._settings.evaders.get(role.evader, game.evader_speed_m_s)
        disc = StandOff(game.standoff.radius_m, game.standoff.height_m + role.above_m)
        self.cycle = replace(
            self.cycle, game=replace(game, evader_speed_m_s=speed_m_s, standoff=disc)
        )

    def _take_aircraft(self, report: messages.Aircraft) -> None:
        """Keep another aircraft like a mate.

        An aircraft at the position of a mate or an evader is that player, and its own reports are better. Reports of
        aircraft are not signed. So only the nearest ones count, and none that moves as no aircraft can.
        """
        frame = self.tracking.local_frame
        here_ned_m = self.position_ned_m
        if frame is None or here_ned_m is None:
            return
        # An unknown height is ours; with an unknown velocity it may fly anywhere.
        altitude_m = report.altitude_amsl_m
        if math.isnan(altitude_m):
            altitude_m = frame.wgs84_from_ned(here_ned_m)[2].metres
        velocity = report.velocity_ned_m_s
        speed_m_s = math.hypot(*velocity)
        if math.isnan(speed_m_s):
            velocity = NOWHERE
            speed_m_s = FASTEST_AIRCRAFT_M_S
        state = MateState(
            report.name,
            report.received_s - report.age_s,
            report.latitude_deg,
            report.longitude_deg,
            altitude_m,
            velocity,
            speed_m_s,
            report.error_m,
            airborne=True,
        )
        reported_ned_m = self._around(state, state.at_s, frame).position_ned_m
        # Silent aircraft are left out. A name that moved as no aircraft can is accepted again after that time.
        self.aircraft = {
            name: other
            for name, other in self.aircraft.items()
            if state.at_s - other.at_s <= FORGOTTEN_S
        }
        self._no_aircraft_s = {
            name: at_s
            for name, at_s in self._no_aircraft_s.items()
            if state.at_s - at_s <= FORGOTTEN_S
        }
        before = self.aircraft.pop(state.name, None)
        # A mate or an evader may be where the aircraft is reported.
        evaders = (self.tracking.evader(report.received_s, name) for name in self._settings.evaders)
        players = [evader.position_ned_m for evader in evaders if evader is not None]
        players += [
            self._around(mate, state.at_s, frame).position_ned_m for mate in self.mates.values()
        ]
        same_m = SAME_M + report.error_m
        if any(math.dist(reported_ned_m, player) <= same_m for player in players):
            return
        if before is not None:
            # No aircraft can reach one of two places from the other.
            way_m = math.dist(_place_in(frame, before), _place_in(frame, state))
            most_m = SAME_M + before.doubt_m + state.doubt_m
            most_m += FASTEST_AIRCRAFT_M_S * (abs(state.at_s - before.at_s) + _AGE_STEP_S)
            if way_m > most_m:
                self._no_aircraft_s[state.name] = state.at_s
        distance_m = math.dist(reported_ned_m, here_ned_m)
        if state.name in self._no_aircraft_s or distance_m > FARTHEST_AIRCRAFT_M:
            return
        self.aircraft[state.name] = state
        if len(self.aircraft) > MOST_AIRCRAFT:
            away_m = {
                name: math.dist(self._around(other, state.at_s, frame).position_ned_m, here_ned_m)
                for name, other in self.aircraft.items()
            }
            farthest = max(away_m, key=lambda name: away_m[name])
            del self.aircraft[farthest]
        since_note_s = report.received_s - self._noted_s
        if before is None and state.name in self.aircraft and since_note_s >= AIRCRAFT_NOTE_EVERY_S:
            self._noted_s = report.received_s
            words = f"{state.name}, {distance_m:.0f} m away, unsigned"
            self.notes.append((Event.AIRCRAFT, words))

    def _place(self) -> None:
        """Compute the positions of vehicle, fences and start in the present local frame."""
        tracking = self.tracking
        held_back_ned_m = self.tracking.held_back_ned_m
        self.moved_ned_m = NOWHERE
        jumps = self.vehicle.jumped_ned_m, held_back_ned_m
        if jumps != self._jumps:
            jumped_ned_m, unmoved_ned_m = self._jumps
            self.moved_ned_m = (jumps[0] - jumps[1]) - (jumped_ned_m - unmoved_ned_m)
            self._jumps = jumps
        home_ned_m = tracking.home_ned_m
        frame = tracking.local_frame
        if home_ned_m is not None and frame is not None and (home_ned_m, frame) != self._home_in:
            self._home_in = home_ned_m, frame
            envelope = replace(self.cycle.envelope, home_ned_m=home_ned_m)
            self.cycle = replace(
                self.cycle, envelope=self._settings.limits.about_home(envelope, home_ned_m, frame)
            )
        game_frame = tracking.game_frame
        start_game_m = self._settings.start_game_m
        if (
            game_frame is not None
            and game_frame is not self._game_frame
            and start_game_m is not None
        ):
            self._game_frame = game_frame
            self.start_ned_m = game_frame.position_to_ned(Enu(start_game_m))
        if (local := self.vehicle.latest.get(LocalPosition)) is not None:
            self.position_ned_m = local.position_ned_m
            if held_back_ned_m != NOWHERE:
                self.position_ned_m = local.position_ned_m - held_back_ned_m

    def view(self, now_s: float) -> CycleInputs | None:
        """Return the inputs of the guidance in this cycle, computed once; None before the first position."""
        vehicle = self.vehicle
        local = self.vehicle.latest.get(LocalPosition)
        if self.seen is None and local is not None and self.position_ned_m is not None:
            evader = self.tracking.evader(now_s)
            estimator = vehicle.latest.get(messages.EstimatorStatus)
            height_sd_m = 0.0
            if estimator is not None:
                height_sd_m = estimator.height_sd_m
                if now_s - estimator.received_s > HEIGHT_ERROR_LIMIT_S:
                    height_sd_m = self.cycle.envelope.floor_margin_m
            evader_ned_m: Ned | None = None
            evader_velocity_ned_m_s: Ned | None = None
            if evader is not None:
                evader_ned_m, evader_velocity_ned_m_s = evader[:2]
            situation = Situation(
                self.position_ned_m,
                local.velocity_ned_m_s,
                vehicle.yaw_rad,
                evader_ned_m,
                evader_velocity_ned_m_s,
                vehicle.acceleration_ned_m_s2,
                height_sd_m,
            )
            others = self.mates | self.aircraft if self.aircraft else self.mates
            mates: list[Separation] = []
            if others:
                mates = [cylinder for _, cylinder in self._near(now_s, others)]
            walls = measure_walls(situation, self.cycle.envelope, mates)
            guided = self.mode is Mode.GUIDED if self.beats else False
            frame = self.tracking.game_frame
            self.seen = CycleInputs(self.dt_s, situation, walls, evader, frame, guided)
        return self.seen

    def distance_refusal(self, now_s: float) -> str:
        """Return why the game's evader is too far away for an engagement; empty if it is not."""
        evader = self.tracking.evader(now_s)
        home_ned_m = self.tracking.home_ned_m
        if evader is None or home_ned_m is None:
            return ""
        game = self.cycle.game
        limit_m = farthest_evader_m(
            self.cycle.envelope.reach_m,
            evader_speed_m_s=game.evader_speed_m_s,
            speed_m_s=game.pursuer.horizontal_m_s,
            standoff_radius_m=float(game.standoff.radius_m),
        )
        distance_m = math.dist(evader.position_ned_m[:2], home_ned_m[:2])
        if distance_m <= limit_m:
            return ""
        return (
            f"the evader is {distance_m:.0f} m from home: beyond {limit_m:.0f} m it cannot be met inside the fence "
            f"of {self.cycle.envelope.reach_m:.0f} m"
        )

    def silent_mate(self, now_s: float) -> str:
        """Return the name of a mate nearby that is silent for longer than `HOLD_S`; empty if there is none."""
        envelope = self.cycle.envelope
        position_ned_m = self.position_ned_m
        stop_m = envelope.speed_m_s * (
            envelope.reaction_s + envelope.speed_m_s / (2.0 * envelope.braking_m_s2)
        )
        for mate, around in self._near(now_s, self.mates):
            beside_m = (
                math.inf
                if position_ned_m is None
                else math.dist(position_ned_m[:2], around.position_ned_m[:2]) - around.radius_m
            )
            if now_s - mate.at_s > HOLD_S and beside_m < 2.0 * stop_m:
                return mate.name
        return ""

    def _near(
        self, now_s: float, others: Mapping[str, MateState]
    ) -> list[tuple[MateState, Separation]]:
        """Return the others that the vehicle must avoid, and the cylinders around them."""
        frame = self.tracking.local_frame
        if frame is None:
            return []
        flying = (
            mate for mate in others.values() if mate.airborne and now_s - mate.at_s <= FORGOTTEN_S
        )
        return [(mate, self._around(mate, now_s, frame)) for mate in flying]

    def _around(self, mate: MateState, now_s: float, frame: LocalFrame) -> Separation:
        """Return the cylinder that contains a mate with its separation, wherever it went since its last state."""
        team = self._settings.team
        if team is None:
            team = TeamSection()
        age_s = max(0.0, now_s - mate.at_s)
        known_s = min(age_s, MATE_SILENT_S)
        last_ned_m = frame.ned_from_wgs84(
            mate.latitude_deg, mate.longitude_deg, Amsl(mate.altitude_amsl_m)
        )
        north, east, down = (
            at + known_s * rate for at, rate in zip(last_ned_m, mate.velocity_ned_m_s, strict=True)
        )
        spread_m = (
            mate.doubt_m
            + 0.5 * _SWERVE_M_S2 * known_s * known_s
            + mate.top_speed_m_s * (age_s - known_s)
        )
        return Separation(
            Ned((north, east, down)),
            team.separation_m + spread_m,
            team.separation_height_m + spread_m,
        )


def _beyond_ordinary(age_s: float) -> float:
    """Return the part of an age that the configured reaction time does not include, in steps."""
    beyond_s = min(age_s, _OLDEST_S) - ORDINARY_AGE_S
    return max(0.0, _LATE_STEP_S * math.ceil(beyond_s / _LATE_STEP_S))


def _place_in(frame: LocalFrame, state: MateState) -> Ned:
    altitude = Amsl(state.altitude_amsl_m)
    return frame.ned_from_wgs84(state.latitude_deg, state.longitude_deg, altitude)


class Echo:
    """Detects a second source of setpoints, by comparing the autopilot's reports with the setpoints we sent.

    POSITION_TARGET_LOCAL_NED repeats the active setpoint, slightly late and perhaps reduced to the autopilot's limits.
    A velocity that we did not send recently comes from another source. Between our setpoints a foreign one is active
    for one cycle only. Therefore the reports are requested at our own rate, and foreign ones count even with ours in
    between.
    """

    def __init__(self) -> None:
        self._sent: deque[tuple[float, Ned]] = deque(maxlen=256)
        self.strange_s: deque[float] = deque(maxlen=STRANGE_REPORTS)
        """Times of the recent foreign reports."""

    @property
    def foreign(self) -> bool:
        """True if the autopilot reports foreign setpoints."""
        return len(self.strange_s) == STRANGE_REPORTS

    def silent(self) -> None:
        """Forget everything, because we send no setpoints."""
        self._sent.clear()
        self.strange_s.clear()

    def sent(self, now_s: float, setpoint: Setpoint) -> None:
        """Note a setpoint that we send."""
        self._sent.append((now_s, setpoint.velocity_ned_m_s))

    def hear(self, reports: Iterable[PositionTarget], *, guided: bool, late_s: float = 0.0) -> None:
        """Compare the autopilot's reports with our setpoints; outside the guided mode they are not ours.

        Args:
            reports: Of this cycle.
            guided: Whether HEARTBEAT shows the guided mode.
            late_s: Delay of the telemetry beyond the ordinary, s.
        """
        remembered_s = REMEMBERED_S + late_s
        for report in reports:
            if not guided:
                self.strange_s.clear()
                continue
            now_s = report.received_s
            while self.strange_s and now_s - self.strange_s[0] > WINDOW_S + _ROUNDING_S:
                self.strange_s.popleft()
            if self.strange_s and now_s - self.strange_s[-1] < APART_S - _ROUNDING_S:
                continue  # counted already
            if not self._sent or now_s - self._sent[0][0] <= remembered_s:
                continue  # our setpoints have just begun
            if not self._is_ours(report, remembered_s):
                self.strange_s.append(now_s)

    def _is_ours(self, report: PositionTarget, remembered_s: float) -> bool:
        reported = report.velocity_ned_m_s
        if not all(map(math.isfinite, reported)):
            return True  # no velocity reported
        for sent_s, sent_ned_m_s in reversed(self._sent):  # usually the latest one
            if report.received_s - sent_s > remembered_s:
                return False
            # The nearest shorter velocity in the sent direction counts too.
            square = sent_ned_m_s.dot(sent_ned_m_s)
            along = reported.dot(sent_ned_m_s) / square if square > 0.0 else 1.0
            share = min(1.0, max(_LEAST_SHARE, along))
            if math.dist(reported, share * sent_ned_m_s) <= TOLERANCE_M_S:
                return True
        return False
