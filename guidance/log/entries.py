"""Entries of a record besides raw frames: cycles, events and evader reports; and the numbers of a recorded cycle."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from guidance.certificate import Certificate
from guidance.clock import Timing
from guidance.flight import Authority, Event, FlightSettings, Inputs, Outputs, State
from guidance.flight.tracking import Tracking, polygon_about_home
from guidance.frames import Amsl, GameFrame, LocalFrame, Vector
from guidance.log.codec import Codec
from guidance.messages import EvaderReport, LocalPosition, MateState, Message, Request, Role, Setpoint, Timesync
from guidance.monitor import Alarm
from guidance.vehicle import VehicleState, observe

CYCLE_TOPIC: Final = "guidance/cycle"
EVENT_TOPIC: Final = "guidance/event"
EVADER_TOPIC: Final = "guidance/evader_report"
"""Every report of the evader as received, at its arrival time."""

BEGUN: Final = "flight begins"
"""Event at the first cycle of a flight. A daemon may fly several; each starts without the state of the last."""

RELOADED: Final = "configuration read again"
"""Event of a configuration reload; the detail is the new configuration as JSON."""

FLIGHT_OVER: Final = "flight over"
"""Last event of a broadcast. Its detail is JSON: how it `ended`, the `record` and its name in the records' `replay`."""

ORDERED: Final = "ordered"
"""Event of an operator order: order, operator and reply."""

STOPPED: Final = "recording has stopped; the flight goes on"
"""Event of a failed record; it goes to the log, the metrics and the bus."""


class InputsEntry(NamedTuple):
    """Inputs of a cycle, without its time."""

    messages: Sequence[Message]
    reports: Sequence[EvaderReport]
    orders: Sequence[Event]
    refusals: Sequence[str] = ()
    alive: bool | None = None
    mission: Sequence[Event] = ()
    mates: Sequence[MateState] | None = None
    role: Role | None = None


class CycleEntry(NamedTuple):
    """One cycle: inputs, outputs, who caused the state (`by`), timing, and the vehicle's name (older records: None)."""

    now_s: float
    state: State
    inputs: InputsEntry
    requests: Sequence[Request]
    setpoint: Setpoint | None = None
    certificate: Certificate | None = None
    alarm: Alarm | None = None
    timing: Timing | None = None
    by: Authority | None = None
    vehicle: str | None = None

    @property
    def flight_inputs(self) -> Inputs:
        """Its inputs as the flight takes them."""
        return Inputs(self.now_s, *self.inputs)


class EventEntry(NamedTuple):
    """One event."""

    now_s: float
    event: str
    detail: str


CYCLE: Final = Codec("guidance.Cycle", CycleEntry)
EVENT: Final = Codec("guidance.Event", EventEntry)
REPORT: Final = Codec("guidance.EvaderReport", EvaderReport)


def cycle_entry(
    inputs: Inputs, outputs: Outputs, timing: Timing | None = None, vehicle: str | None = None
) -> CycleEntry:
    """Return the entry of a cycle of a vehicle."""
    return CycleEntry(
        inputs.now_s,
        outputs.state,
        InputsEntry(*inputs[1:]),
        outputs.requests,
        outputs.setpoint,
        outputs.certificate,
        outputs.alarm,
        timing,
        Authority.FLIGHT if outputs.cause is None else outputs.cause.by,
        vehicle,
    )


_UNKNOWN: Final[Vector] = (math.nan, math.nan, math.nan)


class Cycle(NamedTuple):
    """Numbers of one cycle: positions in the game frame (m), velocities NED (m/s), ages and times (s)."""

    now_s: float
    pursuer_m: Vector = _UNKNOWN
    evader_m: Vector = _UNKNOWN
    flown_ned_m_s: Vector = _UNKNOWN
    commanded_ned_m_s: Vector = _UNKNOWN
    desired_ned_m_s: Vector = _UNKNOWN
    gap_m: float = math.nan
    height_gap_m: float = math.nan
    value: float = math.nan
    meeting_time_s: float = math.nan
    time_needed_s: float = math.nan
    assured_distance_m: float = math.nan
    telemetry_age_s: float = math.nan
    evader_age_s: float = math.nan
    round_trip_s: float = math.nan
    late_s: float = math.nan
    worked_s: float = math.nan


_OF_THE_GAME: Final = tuple(name for name in Cycle._fields if name in Certificate._fields)
"""Numbers that the certificate has under the same name."""


class Aggregator:
    """Tracks both players over the cycles of a record, as the flight did.

    Attributes:
        home_m: Home in the game frame; None until known.
        envelope: The limits of the flight. A fence given in degrees is included once home is known.
    """

    def __init__(self, settings: FlightSettings) -> None:
        self._settings = settings
        self._tracking = Tracking(settings.cycle, settings.autopilot)
        self._vehicle = VehicleState()
        self._evader_m: Vector = _UNKNOWN
        self._report_s = math.nan
        self._home_ned_m: Vector | None = None
        self.home_m: Vector | None = None
        self.envelope = settings.cycle.envelope

    def cycle(self, row: CycleEntry) -> Cycle:
        """Take the next cycle and return its numbers."""
        inputs = row.inputs
        self._vehicle = observe(self._vehicle, inputs.messages)
        self._tracking.observe(self._vehicle, ())
        for report in inputs.reports:
            self._add(report)
        frame = self._tracking.game_frame
        self._place_home(self._tracking.home_ned_m, frame, self._tracking.local_frame)
        local, setpoint, certificate = self._vehicle.last(LocalPosition), row.setpoint, row.certificate
        trips = [one.received_s - one.local_ns * 1e-9 for one in inputs.messages if isinstance(one, Timesync)]
        cycle = Cycle(
            row.now_s,
            evader_m=self._evader_m,
            evader_age_s=row.now_s - self._report_s,
            round_trip_s=next((trip for trip in trips if 0.0 <= trip < 10.0), math.nan),
            late_s=math.nan if row.timing is None else row.timing.late_s,
            worked_s=math.nan if row.timing is None else row.timing.worked_s,
        )
        if local is not None:
            position_m = _UNKNOWN if frame is None else frame.position_from_ned(local.position_ned_m)
            age_s = row.now_s - local.received_s
            cycle = cycle._replace(pursuer_m=position_m, flown_ned_m_s=local.velocity_ned_m_s, telemetry_age_s=age_s)
        if setpoint is not None:
            cycle = cycle._replace(commanded_ned_m_s=setpoint.velocity_ned_m_s)
        if certificate is not None:
            played = {name: getattr(certificate, name) for name in _OF_THE_GAME}
            cycle = cycle._replace(evader_m=certificate.evader_game_m, **played)
        return cycle

    def _place_home(self, home_ned_m: Vector | None, game: GameFrame | None, local: LocalFrame | None) -> None:
        """Place home, and a fence in degrees about it."""
        if home_ned_m is None or game is None or local is None or home_ned_m == self._home_ned_m:
            return
        self._home_ned_m, self.home_m = home_ned_m, game.position_from_ned(home_ned_m)
        corners_deg = self._settings.limits.fence_polygon_deg
        if corners_deg is not None:
            polygon = polygon_about_home(corners_deg, home_ned_m, local)
            self.envelope = replace(self.envelope, fence_polygon=polygon)

    def _add(self, report: EvaderReport) -> None:
        self._report_s = report.received_s
        local, game = self._tracking.local_frame, self._tracking.game_frame
        if local is None or game is None:
            return
        amsl = Amsl(report.altitude_amsl_m)
        self._evader_m = game.position_from_ned(local.ned_from_wgs84(report.latitude_deg, report.longitude_deg, amsl))
