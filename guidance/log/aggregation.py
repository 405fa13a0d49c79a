"""Numbers of each recorded cycle: positions, velocities, ages and times; NaN if unknown."""

import math
from dataclasses import replace
from typing import NamedTuple

from guidance.certificate import Certificate
from guidance.control import Envelope
from guidance.flight import FlightSettings
from guidance.flight.tracking import Tracking, polygon_about_home
from guidance.frames import Amsl, LocalFrame, Vector
from guidance.log.entries import CycleEntry
from guidance.messages import EvaderReport, LocalPosition, Timesync
from guidance.vehicle import VehicleState, observe

_UNKNOWN = (math.nan, math.nan, math.nan)


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
        self.envelope: Envelope = settings.cycle.envelope

    def cycle(self, row: CycleEntry) -> Cycle:
        """Take the next cycle and return its numbers."""
        inputs = row.inputs
        self._vehicle = observe(self._vehicle, inputs.messages)
        self._tracking.observe(self._vehicle, ())
        for report in inputs.reports:
            self._add(report)
        frame = self._tracking.game_frame
        home_ned_m, local_frame = self._tracking.home_ned_m, self._tracking.local_frame
        if home_ned_m is not None and frame is not None and local_frame is not None and home_ned_m != self._home_ned_m:
            self._home_ned_m = home_ned_m
            self.home_m = frame.position_from_ned(home_ned_m)
            self.envelope = self._limits(home_ned_m, local_frame)
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
        return cycle if certificate is None else _with_game(cycle, certificate)

    def _limits(self, home_ned_m: Vector, frame: LocalFrame) -> Envelope:
        """Convert a fence in degrees to metres about home."""
        envelope, corners_deg = self._settings.cycle.envelope, self._settings.limits.fence_polygon_deg
        if corners_deg is None:
            return envelope
        return replace(envelope, fence_polygon=polygon_about_home(corners_deg, home_ned_m, frame))

    def _add(self, report: EvaderReport) -> None:
        self._report_s = report.received_s
        local, game = self._tracking.local_frame, self._tracking.game_frame
        if local is None or game is None:
            return
        amsl = Amsl(report.altitude_amsl_m)
        self._evader_m = game.position_from_ned(local.ned_from_wgs84(report.latitude_deg, report.longitude_deg, amsl))


def _with_game(cycle: Cycle, certificate: Certificate) -> Cycle:
    return cycle._replace(
        evader_m=certificate.evader_game_m,
        desired_ned_m_s=certificate.desired_ned_m_s,
        gap_m=certificate.gap_m,
        height_gap_m=certificate.height_gap_m,
        value=certificate.value,
        meeting_time_s=certificate.meeting_time_s,
        time_needed_s=certificate.time_needed_s,
        assured_distance_m=certificate.assured_distance_m,
    )
