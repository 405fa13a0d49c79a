"""Where the zero of the vehicle's local frame lies on Earth, and when it is elsewhere.

GPS_GLOBAL_ORIGIN says so (without it, home does). A position that jumps can mean two things: that the estimator thinks
better of where the vehicle is, which leaves the zero where it was; or that the zero was moved, which is told a moment
earlier, later, or not at all. And what is told may be wrong. GLOBAL_POSITION_INT decides: of all zeros that are
possible, the one is believed with which the vehicle's local position lies nearest to its global one. Until the next
one comes a jump is held back, so that nothing is commanded by a place of the one frame in the other.
"""

import math
from dataclasses import replace
from typing import Final

from guidance.frames import Amsl, LocalFrame, MapProjection, Vector
from guidance.messages import GlobalPosition, LocalPosition
from guidance.vehicle import VehicleState, local_frame

NOWHERE: Final[Vector] = (0.0, 0.0, 0.0)

HARMLESS_M: Final = 0.5
"""A zero told to be no further away than this is taken as it is: it was rounded, or reckoned from home."""

_JUDGE_AGE_S: Final = 1.0
"""Without a global position this young there is nobody to ask, and what is told is believed."""


class Zero:
    """The zero as believed. `held_back_ned_m` is a jump of the position of which nobody knows yet what it means."""

    def __init__(self, projection: MapProjection) -> None:
        self._projection = projection
        self._frame: LocalFrame | None = None
        self._jumped: Vector = (0.0, 0.0, 0.0)
        self.held_back_ned_m: Vector = NOWHERE

    def observe(self, vehicle: VehicleState) -> LocalFrame | None:
        """Take in what was heard in one cycle; None until the vehicle has told where it is."""
        told = local_frame(vehicle, self._projection)
        if told is None:
            return self._frame
        told = replace(told, home=None)  # heights above home may change; the frame is the same
        self._note_jump(vehicle)
        if self._frame is None or _is_harmless(self._frame, told):
            self._frame = told
        if told != self._frame or self.held_back_ned_m != NOWHERE:
            self._frame = self._judged(self._frame, told, vehicle)
        return self._frame

    def _note_jump(self, vehicle: VehicleState) -> None:
        rows = zip(self.held_back_ned_m, vehicle.jumped_ned_m, self._jumped, strict=True)
        north, east, down = (held_back + now - was for held_back, now, was in rows)
        self._jumped, self.held_back_ned_m = vehicle.jumped_ned_m, (north, east, down)

    def _judged(self, held: LocalFrame, told: LocalFrame, vehicle: VehicleState) -> LocalFrame:
        """Choose between where the zero was, where it is told to be, and where a jump would have put it."""
        place, local = vehicle.last(GlobalPosition), vehicle.last(LocalPosition)
        if place is None or local is None or local.received_s - place.received_s > _JUDGE_AGE_S:
            self.held_back_ned_m = NOWHERE
            return told
        if place.time_boot_s < vehicle.jumped_boot_s:
            return held  # it is from before
        possible = (held, told, _jumped_zero(held, self.held_back_ned_m))
        self.held_back_ned_m = NOWHERE
        return min(possible, key=lambda frame: _apart_m(frame, place, local))


def _is_harmless(held: LocalFrame, told: LocalFrame) -> bool:
    return told != held and math.hypot(*told.ned_in(held, (0.0, 0.0, 0.0))) <= HARMLESS_M


def _jumped_zero(held: LocalFrame, jump_ned_m: Vector) -> LocalFrame:
    north, east, down = jump_ned_m
    latitude_deg, longitude_deg, altitude = held.wgs84_from_ned((-north, -east, -down))
    return replace(held, latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude=altitude)


def _apart_m(frame: LocalFrame, place: GlobalPosition, local: LocalPosition) -> float:
    """How far the vehicle's own two words on where it is lie apart, if this were the frame."""
    step_s = place.time_boot_s - local.time_boot_s
    then = [at + step_s * rate for at, rate in zip(local.position_ned_m, local.velocity_ned_m_s, strict=True)]
    altitude = Amsl(place.altitude_amsl_m)
    return math.dist(then, frame.ned_from_wgs84(place.latitude_deg, place.longitude_deg, altitude))
