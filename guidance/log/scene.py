"""Messages that viewers draw without setup: both players on the map, and the game in three dimensions.

The schemas and field names are those of Foxglove (docs.foxglove.dev, "message schemas"); Lichtblick and others read
them too. Positions are in metres, x east, y north, z up. A time is seconds and nanoseconds of the record's clock.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

from guidance.certificate import Certificate
from guidance.frames import Vector
from guidance.log.codec import DIALECT, Schema
from guidance.log.entries import CycleEntry
from guidance.messages import EvaderReport, GlobalPosition

EVERY_S: Final = 0.1
SCENE_EVERY_S: Final = 0.2
"""Periods of the map and pose messages, and of the scene."""

GAME_FRAME: Final = "game"
_CORNERS: Final = 36
_UNKNOWN: Final = 0
_DIAGONAL_KNOWN: Final = 2

_INTEGER: Final = {"type": "integer"}
_NUMBER: Final = {"type": "number"}
_TEXT: Final = {"type": "string"}
_TRUTH: Final = {"type": "boolean"}
_UNUSED: Final = ("metadata", "arrows", "cubes", "cylinders", "triangles", "texts", "models")
"""Lists of a scene entity that viewers expect and that stay empty here."""


def _object(**fields: Schema) -> Schema:
    required = [name for name in fields if name != "altitude"]  # may be unknown
    return {"type": "object", "properties": fields, "required": required, "additionalProperties": False}


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


_TIME: Final = _object(sec=_INTEGER, nsec=_INTEGER)
_VECTOR: Final = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_POSE: Final = _object(position=_VECTOR, orientation=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER))
_COLOR: Final = _object(r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_EMPTY: Final = _list(_object())
_SPHERE: Final = _object(pose=_POSE, size=_VECTOR, color=_COLOR)
_LINE: Final = _object(
    type=_INTEGER,
    pose=_POSE,
    thickness=_NUMBER,
    scale_invariant=_TRUTH,
    points=_list(_VECTOR),
    color=_COLOR,
    colors=_list(_COLOR),
    indices=_list(_INTEGER),
)
_ENTITY: Final = _object(
    timestamp=_TIME,
    frame_id=_TEXT,
    id=_TEXT,
    lifetime=_TIME,
    frame_locked=_TRUTH,
    spheres=_list(_SPHERE),
    lines=_list(_LINE),
    **dict.fromkeys(_UNUSED, _EMPTY),
)


class Shape(NamedTuple):
    """Name and JSON Schema of one type of message."""

    title: str
    schema: Schema


def _shape(title: str, content: Schema) -> Shape:
    return Shape(title, {"$schema": DIALECT, "title": title, **content})


FIX: Final = _shape(
    "foxglove.LocationFix",
    _object(
        timestamp=_TIME,
        frame_id=_TEXT,
        latitude=_NUMBER,
        longitude=_NUMBER,
        altitude=_NUMBER,
        position_covariance={**_list(_NUMBER), "maxItems": 9},
        position_covariance_type=_INTEGER,
    ),
)
POSE: Final = _shape("foxglove.PoseInFrame", _object(timestamp=_TIME, frame_id=_TEXT, pose=_POSE))
SCENE: Final = _shape("foxglove.SceneUpdate", _object(entities=_list(_ENTITY), deletions=_EMPTY))
SHAPES: Final = (FIX, POSE, SCENE)

_PURSUER: Final = {"r": 0.70, "g": 0.15, "b": 0.12, "a": 1.0}
_EVADER: Final = {"r": 0.04, "g": 0.37, "b": 0.65, "a": 1.0}
_MEETING: Final = {"r": 0.90, "g": 0.80, "b": 0.20, "a": 1.0}
_DISC: Final = {"r": 0.18, "g": 0.49, "b": 0.20, "a": 1.0}


class Drawn(NamedTuple):
    """One message for viewers."""

    topic: str
    shape: Shape
    message: dict[str, Any]


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
        if self._is_due("guidance/pose", entry.now_s):
            yield from _poses(entry.now_s, certificate)
        if self._is_due("guidance/scene", entry.now_s, every_s=SCENE_EVERY_S):
            yield _game(entry.now_s, certificate)

    def _is_due(self, topic: str, now_s: float, every_s: float = EVERY_S) -> bool:
        # A tenth of a period early is accepted, since cycles do not fall on this grid.
        due = now_s - self._drawn_s.get(topic, -math.inf) >= 0.9 * every_s
        if due:
            self._drawn_s[topic] = now_s
        return due


def _fix(name: str, report: GlobalPosition | EvaderReport, sd_m: float) -> Drawn:
    variance, kind = (0.0, _UNKNOWN) if math.isnan(sd_m) else (sd_m * sd_m, _DIAGONAL_KNOWN)
    message = {
        "timestamp": time_of(report.received_s),
        "frame_id": name,
        "latitude": report.latitude_deg,
        "longitude": report.longitude_deg,
        "position_covariance": [variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance],
        "position_covariance_type": kind,
    }
    if math.isfinite(report.altitude_amsl_m):
        message["altitude"] = report.altitude_amsl_m  # above mean sea level
    return Drawn(f"guidance/map/{name}", FIX, message)


def _poses(now_s: float, certificate: Certificate) -> Iterator[Drawn]:
    for name, place in (("pursuer", certificate.pursuer_game_m), ("evader", certificate.evader_game_m)):
        message = {"timestamp": time_of(now_s), "frame_id": GAME_FRAME, "pose": _pose(place)}
        yield Drawn(f"guidance/pose/{name}", POSE, message)


def _game(now_s: float, certificate: Certificate) -> Drawn:
    spheres = [_ball(certificate.pursuer_game_m, 1.0, _PURSUER), _ball(certificate.evader_game_m, 1.0, _EVADER)]
    if not certificate.no_game:
        spheres.append(_ball(certificate.meeting_point_game_m, 0.6, _MEETING))
    rim = {
        "type": 1,  # a closed line
        "pose": _pose((0.0, 0.0, 0.0)),
        "thickness": 2.0,  # pixels
        "scale_invariant": True,
        "points": [_vector(corner) for corner in disc(certificate)],
        "color": _DISC,
        "colors": [],
        "indices": [],
    }
    entity = {
        "timestamp": time_of(now_s),
        "frame_id": GAME_FRAME,
        "id": "game",
        "lifetime": time_of(0.0),  # until it is drawn again
        "frame_locked": False,
        "spheres": spheres,
        "lines": [rim],
        **dict.fromkeys(_UNUSED, ()),
    }
    return Drawn("guidance/scene", SCENE, {"entities": [entity], "deletions": []})


def disc(certificate: Certificate) -> Sequence[Vector]:
    """Return corners of the rim of the stand-off disc, game frame, from the distances in the certificate."""
    (x, y, z), above = certificate.evader_game_m, certificate.pursuer_game_m
    radius_m = math.hypot(above[0] - x, above[1] - y) - certificate.gap_m
    height_m = above[2] - z - certificate.height_gap_m
    turns = (2.0 * math.pi * corner / _CORNERS for corner in range(_CORNERS))
    return [(x + radius_m * math.cos(turn), y + radius_m * math.sin(turn), z + height_m) for turn in turns]


def time_of(now_s: float) -> dict[str, int]:
    """Split seconds; viewers have no negative times, which become zero."""
    nanoseconds = max(0, round(now_s * 1e9))
    return {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}


def _vector(place: Vector) -> dict[str, float]:
    return {"x": place[0], "y": place[1], "z": place[2]}


def _pose(place: Vector) -> dict[str, dict[str, float]]:
    return {"position": _vector(place), "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}


def _ball(place: Vector, diameter_m: float, color: dict[str, float]) -> dict[str, Any]:
    return {"pose": _pose(place), "size": _vector((diameter_m, diameter_m, diameter_m)), "color": color}
