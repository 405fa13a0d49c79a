"""A flight as viewers of records draw it unasked: both on the map, and the game in three dimensions.

Foxglove, Lichtblick and others draw some types of messages without being set up. Those that a flight needs are here,
field for field those of docs.foxglove.dev, "message schemas"; the names of types and fields are theirs. Positions are
metres, x east, y north, z up; a time is seconds and nanoseconds of the clock of the record.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

from guidance.certificate import Certificate
from guidance.frames import Vector
from guidance.log.codec import Codec
from guidance.log.entries import CycleEntry
from guidance.messages import EvaderReport, GlobalPosition

UNKNOWN: Final = 0
DIAGONAL_KNOWN: Final = 2
_NO_COVARIANCE: Final = (0.0,) * 9
EVERY_S: Final = 0.1
SCENE_EVERY_S: Final = 0.2
"""A map and a scene are looked at: ten and five times a second are enough."""

GAME_FRAME: Final = "game"
_CORNERS: Final = 36


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


_PURSUER: Final = Color(0.70, 0.15, 0.12)
_EVADER: Final = Color(0.04, 0.37, 0.65)
_MEETING: Final = Color(0.90, 0.80, 0.20)
_DISC: Final = Color(0.18, 0.49, 0.20)


class Drawn(NamedTuple):
    """One message for viewers: its topic, what writes it, and itself."""

    topic: str
    codec: Codec[Any]
    message: Any


_FIX: Final = Codec("foxglove.LocationFix", LocationFix)
_POSE: Final = Codec("foxglove.PoseInFrame", PoseInFrame)
_SCENE: Final = Codec("foxglove.SceneUpdate", SceneUpdate)
DRAWN: Final = (_FIX, _POSE, _SCENE)


class Scene:
    """Makes the messages of each cycle. It remembers when each topic was last drawn."""

    def __init__(self) -> None:
        self._drawn_s: dict[str, float] = {}

    def of(self, entry: CycleEntry) -> Iterator[Drawn]:
        """Draw one cycle."""
        for message in entry.inputs.messages:
            if isinstance(message, GlobalPosition) and self._is_due("guidance/map/pursuer", message.received_s):
                yield _fix("pursuer", message, math.nan)
        for report in entry.inputs.reports:
            if self._is_due("guidance/map/evader", report.received_s):
                yield _fix("evader", report, report.position_sd_m)
        certificate = entry.certificate
        if certificate is None:
            return
        now_s = entry.now_s
        if self._is_due("guidance/pose", now_s):
            yield from _poses(now_s, certificate)
        if self._is_due("guidance/scene", now_s, every_s=SCENE_EVERY_S):
            yield _game(now_s, certificate)

    def _is_due(self, topic: str, now_s: float, every_s: float = EVERY_S) -> bool:
        # A tenth of a period early still counts: cycles do not fall on our grid.
        due = now_s - self._drawn_s.get(topic, -math.inf) >= 0.9 * every_s
        if due:
            self._drawn_s[topic] = now_s
        return due


def _fix(name: str, said: GlobalPosition | EvaderReport, sd_m: float) -> Drawn:
    place = (said.latitude_deg, said.longitude_deg, said.altitude_amsl_m)
    return Drawn(f"guidance/map/{name}", _FIX, fix(said.received_s, name, *place, sd_m=sd_m))


def _poses(now_s: float, certificate: Certificate) -> Iterator[Drawn]:
    for name, place in (("pursuer", certificate.pursuer_game_m), ("evader", certificate.evader_game_m)):
        yield Drawn(f"guidance/pose/{name}", _POSE, pose(now_s, GAME_FRAME, place))


def _game(now_s: float, certificate: Certificate) -> Drawn:
    pursuer, evader = certificate.pursuer_game_m, certificate.evader_game_m
    spheres = [ball(pursuer, 1.0, _PURSUER), ball(evader, 1.0, _EVADER)]
    if not certificate.no_game:
        spheres.append(ball(certificate.meeting_point_game_m, 0.6, _MEETING))
    entity = SceneEntity(
        time_of(now_s),
        GAME_FRAME,
        "game",
        Time(0, 0),
        frame_locked=False,
        spheres=tuple(spheres),
        lines=(ring(tuple(disc(certificate)), _DISC),),
    )
    return Drawn("guidance/scene", _SCENE, SceneUpdate((entity,)))


def disc(certificate: Certificate) -> Sequence[Vector]:
    """Corners of the stand-off disc's rim, game frame, as the certificate's distances to it have it."""
    (x, y, z), above = certificate.evader_game_m, certificate.pursuer_game_m
    radius_m = math.hypot(above[0] - x, above[1] - y) - certificate.gap_m
    height_m = above[2] - z - certificate.height_gap_m
    turns = (2.0 * math.pi * corner / _CORNERS for corner in range(_CORNERS))
    return [(x + radius_m * math.cos(turn), y + radius_m * math.sin(turn), z + height_m) for turn in turns]
