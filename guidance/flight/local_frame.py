"""The origin of the vehicle's local frame on Earth, and everything that moves when the origin or the estimate jumps.

GPS_GLOBAL_ORIGIN tells the origin (without it, home does). A position that jumps means one of two things: the
estimator has corrected where the vehicle is, which leaves the origin where it was; or the origin was moved, which is
told a moment earlier, later, or not at all. And what is told may be wrong. GLOBAL_POSITION_INT decides: of all
possible origins, the one is believed with which the vehicle's local position lies nearest to its global one. Until the
next one comes a jump is held back, so that nothing is commanded by a place of the one frame in the other.
"""

import math
from dataclasses import replace
from typing import Final

from guidance.control import Polygon
from guidance.cycle import CycleMemory
from guidance.frames import Amsl, LocalFrame, MapProjection, Vector
from guidance.messages import GlobalPosition, Home, LocalPosition, Message, Origin
from guidance.vehicle import VehicleState, local_frame

NOWHERE: Final[Vector] = (0.0, 0.0, 0.0)

HARMLESS_M: Final = 0.5
"""An origin told to be no further away than this is taken as it is: it was rounded, or derived from home."""

Corners = tuple[tuple[float, float], ...]
"""Latitude and longitude of each corner of a fence, degrees."""

_JUDGE_AGE_S: Final = 1.0
"""Without a global position this recent there is no second source, and what is told is believed."""


class OriginEstimate:
    """The origin as believed. `held_back_ned_m` is a jump of the position whose meaning is not known yet."""

    def __init__(self, projection: MapProjection) -> None:
        self._projection = projection
        self._frame: LocalFrame | None = None
        self._telling: tuple[Message | None, Message | None] = (None, None)
        self._told_frame: LocalFrame | None = None
        self._jumped: Vector = (0.0, 0.0, 0.0)
        self.held_back_ned_m: Vector = NOWHERE

    def observe(self, vehicle: VehicleState) -> LocalFrame | None:
        """Take in what was heard in one cycle; None until the vehicle has told where it is."""
        told = self._told(vehicle)
        if told is None:
            return self._frame
        if vehicle.jumped_ned_m != self._jumped:
            self._note_jump(vehicle)
        if told is self._frame and self.held_back_ned_m == NOWHERE:
            return told
        if self._frame is None or _is_harmless(self._frame, told):
            self._frame = told
        if told != self._frame or self.held_back_ned_m != NOWHERE:
            self._frame = self._judged(self._frame, told, vehicle)
        return self._frame

    def _told(self, vehicle: VehicleState) -> LocalFrame | None:
        """Return the frame that the vehicle tells, reckoned anew only once it tells another."""
        telling = vehicle.latest.get(Home), vehicle.latest.get(Origin)
        if telling != self._telling:
            self._telling, told = telling, local_frame(vehicle, self._projection)
            # Heights above home may change; the frame is the same.
            self._told_frame = None if told is None else replace(told, home=None)
        return self._told_frame

    def _note_jump(self, vehicle: VehicleState) -> None:
        rows = zip(self.held_back_ned_m, vehicle.jumped_ned_m, self._jumped, strict=True)
        north, east, down = (held_back + now - was for held_back, now, was in rows)
        self._jumped, self.held_back_ned_m = vehicle.jumped_ned_m, (north, east, down)

    def _judged(self, held: LocalFrame, told: LocalFrame, vehicle: VehicleState) -> LocalFrame:
        """Choose between where the origin was, where it is told to be, and where a jump would have put it."""
        place, local = vehicle.last(GlobalPosition), vehicle.last(LocalPosition)
        if place is None or local is None or local.received_s - place.received_s > _JUDGE_AGE_S:
            self.held_back_ned_m = NOWHERE
            return told
        if place.time_boot_s < vehicle.jumped_boot_s:
            return held  # it is from before
        possible = (held, told, _jumped_origin(held, self.held_back_ned_m))
        self.held_back_ned_m = NOWHERE
        return min(possible, key=lambda frame: _apart_m(frame, place, local))


def _is_harmless(held: LocalFrame, told: LocalFrame) -> bool:
    return told != held and math.hypot(*told.ned_in(held, (0.0, 0.0, 0.0))) <= HARMLESS_M


def _jumped_origin(held: LocalFrame, jump_ned_m: Vector) -> LocalFrame:
    north, east, down = jump_ned_m
    latitude_deg, longitude_deg, altitude = held.wgs84_from_ned((-north, -east, -down))
    return replace(held, latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude=altitude)


def _apart_m(frame: LocalFrame, place: GlobalPosition, local: LocalPosition) -> float:
    """Distance between the vehicle's local and global positions, if this were the frame."""
    step_s = place.time_boot_s - local.time_boot_s
    then = [at + step_s * rate for at, rate in zip(local.position_ned_m, local.velocity_ned_m_s, strict=True)]
    altitude = Amsl(place.altitude_amsl_m)
    return math.dist(then, frame.ned_from_wgs84(place.latitude_deg, place.longitude_deg, altitude))


def shifted(memory: CycleMemory, jump_ned_m: Vector) -> CycleMemory:
    """Shift the place and the height that a hover holds, and the drift's position, by a jump of the estimate.

    The vehicle is then held where it is, not sent to where it now believes that it was.

    Args:
        memory: Of the cycle before the jump.
        jump_ned_m: By how much the estimate jumped, metres.
    """
    north_m, east_m, down_m = jump_ned_m
    if not any(jump_ned_m):
        return memory
    drift, place, height = memory.follow.drift, memory.place, memory.height
    if drift.position_ned_m is not None:
        north, east, down = drift.position_ned_m
        drift = drift._replace(position_ned_m=(north + north_m, east + east_m, down + down_m))
    return memory._replace(
        follow=memory.follow._replace(drift=drift),
        place=None if place is None else (place[0] + north_m, place[1] + east_m),
        height=None if height is None else height._replace(down_m=height.down_m + down_m),
    )


def difference(one: Vector, other: Vector) -> Vector:
    """Return `one` - `other`."""
    (north, east, down), (other_north, other_east, other_down) = one, other
    return (north - other_north, east - other_east, down - other_down)


def polygon_about_home(corners_deg: Corners, home_ned_m: Vector, frame: LocalFrame) -> Polygon:
    """Return the polygon in metres about home, by the autopilot's own map between degrees and metres.

    Args:
        corners_deg: As configured.
        home_ned_m: Home in the local frame, whose origin need not be there.
        frame: The vehicle's local frame.

    Raises:
        ConfigError: If the corners make no polygon.
    """
    north_m, east_m, _ = home_ned_m
    places = [frame.ned_from_wgs84(latitude, longitude, frame.altitude) for latitude, longitude in corners_deg]
    return Polygon(tuple((north - north_m, east - east_m) for north, east, _ in places))
