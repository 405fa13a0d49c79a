"""The message types that Foxglove, Lichtblick and others draw without being set up, as far as a flight needs them.

Field for field those of docs.foxglove.dev, "message schemas"; the names of types and fields are theirs. Positions are
metres, x east, y north, z up; a time is seconds and nanoseconds of the record's clock.
"""

import math
from typing import Final, NamedTuple

from guidance.frames import Vector


class Time(NamedTuple):
    """A moment, or a length of time."""

    sec: int
    nsec: int


class Vector3(NamedTuple):
    """A point or a direction."""

    x: float
    y: float
    z: float


class Quaternion(NamedTuple):
    """An orientation; the default turns nothing."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Pose(NamedTuple):
    """Where something is and how it is turned."""

    position: Vector3
    orientation: Quaternion = Quaternion()


class Color(NamedTuple):
    """0 to 1 each."""

    r: float
    g: float
    b: float
    a: float = 1.0


class LocationFix(NamedTuple):
    """foxglove.LocationFix: a place on the map. Altitude here is above mean sea level."""

    timestamp: Time
    frame_id: str
    latitude: float
    longitude: float
    altitude: float
    position_covariance: tuple[float, float, float, float, float, float, float, float, float]
    position_covariance_type: int


class PoseInFrame(NamedTuple):
    """foxglove.PoseInFrame: a pose in 3D."""

    timestamp: Time
    frame_id: str
    pose: Pose


class Absent(NamedTuple):
    """What a scene here never has."""


class SpherePrimitive(NamedTuple):
    """foxglove.SpherePrimitive: `size` is the diameters."""

    pose: Pose
    size: Vector3
    color: Color


class LinePrimitive(NamedTuple):
    """foxglove.LinePrimitive: type 0 is a strip, 1 a loop; scale invariant, the thickness is in pixels."""

    type: int
    pose: Pose
    thickness: float
    scale_invariant: bool
    points: tuple[Vector3, ...]
    color: Color
    colors: tuple[Color, ...] = ()
    indices: tuple[int, ...] = ()


class SceneEntity(NamedTuple):
    """foxglove.SceneEntity: what is drawn under one `id`, until it is drawn anew."""

    timestamp: Time
    frame_id: str
    id: str
    lifetime: Time
    frame_locked: bool
    spheres: tuple[SpherePrimitive, ...]
    lines: tuple[LinePrimitive, ...]
    metadata: tuple[Absent, ...] = ()
    arrows: tuple[Absent, ...] = ()
    cubes: tuple[Absent, ...] = ()
    cylinders: tuple[Absent, ...] = ()
    triangles: tuple[Absent, ...] = ()
    texts: tuple[Absent, ...] = ()
    models: tuple[Absent, ...] = ()


class SceneUpdate(NamedTuple):
    """foxglove.SceneUpdate: what has changed in a scene."""

    entities: tuple[SceneEntity, ...]
    deletions: tuple[Absent, ...] = ()


UNKNOWN: Final = 0
DIAGONAL_KNOWN: Final = 2
_NO_COVARIANCE: Final = (0.0,) * 9


def time_of(now_s: float) -> Time:
    """Split seconds; times before the clock's zero are not told by viewers, and become zero."""
    nanoseconds = max(0, round(now_s * 1e9))
    return Time(nanoseconds // 1_000_000_000, nanoseconds % 1_000_000_000)


def fix(
    now_s: float, frame_id: str, latitude_deg: float, longitude_deg: float, altitude_m: float, sd_m: float = math.nan
) -> LocationFix:
    """A place as a sensor has it.

    Args:
        now_s: When it was.
        frame_id: The sensor's frame, by name.
        latitude_deg: WGS 84.
        longitude_deg: WGS 84.
        altitude_m: Above mean sea level.
        sd_m: Its standard deviation in each axis, NaN where that is not known.
    """
    if math.isnan(sd_m):
        covariance, kind = _NO_COVARIANCE, UNKNOWN
    else:
        variance = sd_m * sd_m
        covariance = (variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance)
        kind = DIAGONAL_KNOWN
    return LocationFix(time_of(now_s), frame_id, latitude_deg, longitude_deg, altitude_m, covariance, kind)


def pose(now_s: float, frame_id: str, position_m: Vector) -> PoseInFrame:
    """A position, turned nowhere."""
    return PoseInFrame(time_of(now_s), frame_id, Pose(Vector3(*position_m)))


def ball(position_m: Vector, diameter_m: float, color: Color) -> SpherePrimitive:
    """A sphere."""
    return SpherePrimitive(Pose(Vector3(*position_m)), Vector3(diameter_m, diameter_m, diameter_m), color)


def ring(points_m: tuple[Vector, ...], color: Color) -> LinePrimitive:
    """A closed line, two pixels wide."""
    return LinePrimitive(1, Pose(Vector3(0.0, 0.0, 0.0)), 2.0, True, tuple(Vector3(*one) for one in points_m), color)
