"""Drawings of a flight: its shapes as arrays, and the messages of a record that viewers draw without setup.

Shapes are in the game frame (m, x east, y north): discs, isochrons, the edges of target and fence.

The messages show both players on the map, and the game in three dimensions. Names and fields are those of Foxglove's
message schemas (docs.foxglove.dev); Lichtblick and others read them too. Positions are in the game frame, with z up. A
time is seconds and nanoseconds of the record's clock.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from guidance.control import Envelope
from guidance.cycle import Certificate, CycleSettings, game_played
from guidance.frames import Enu
from guidance.game import Extent, Game, solve
from guidance.game.arrays import FloatArray
from guidance.log.codec import DIALECT, Schema
from guidance.log.entries import CycleEntry
from guidance.messages import EvaderReport, GlobalPosition

POSE_EVERY_S: Final = 0.1
SCENE_EVERY_S: Final = 0.2
"""Periods of the map and pose messages, and of the scene."""

GAME_FRAME: Final = "game"
_UNKNOWN = 0
_DIAGONAL_KNOWN = 2
_CLOSED_LINE = 1  # of Foxglove's enumerations
_ZERO: Final = Enu((0.0, 0.0, 0.0))
_UNUSED: Final = ("metadata", "arrows", "cubes", "cylinders", "triangles", "texts", "models")
"""Lists of a scene entity that viewers expect and that stay empty here."""

Json = dict[str, Any]


def circle_points(
    centre: Sequence[float] | FloatArray, radius_m: float, points: int = 181
) -> FloatArray:
    """A closed circle (points, 2), seen from above."""
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    return np.stack(
        [centre[0] + radius_m * np.cos(angle), centre[1] + radius_m * np.sin(angle)], axis=-1
    )


def lifted(curve: FloatArray, height_m: float) -> FloatArray:
    """Lift a curve (n, 2) to a height: (n, 3)."""
    return np.column_stack([curve, np.full(len(curve), height_m)])


def target_edge(place_m: Enu, extent: Extent) -> FloatArray:
    """The closed edge (n, 2) of a target's shape about its place; of a point nothing."""
    edge = np.array(extent.outline_m()).reshape(-1, 2) + np.array(place_m[:2])
    return np.concatenate([edge, edge[:1]])


def isochron(
    game: Game, pursuer_m: Enu | FloatArray, evader_m: Enu | FloatArray, points: int = 181
) -> FloatArray:
    """Capture points (points, 2) of an evader that runs straight at full speed, one for each heading, m.

    The paper's Apollonius circle for a Ball and point capture. Found from the game itself: TAD towards a far target in
    each heading ends where that heading's run ends.

    Args:
        game: The game.
        pursuer_m: P, m.
        evader_m: E, m.
        points: How many headings.
    """
    headings = np.linspace(0.0, 2.0 * np.pi, points)
    far = 1e6 * np.stack([np.cos(headings), np.sin(headings), np.zeros(points)], axis=-1)
    return np.asarray(
        solve(game, pursuer_m, evader_m, np.asarray(evader_m) + far).meeting_point_m[:, :2]
    )


def isochron_at(settings: CycleSettings, certificate: Certificate, points: int = 181) -> FloatArray:
    """The isochron (points, 2) of the cycle's game. It contains the meeting point."""
    bound_m_s = settings.game.pursuer.horizontal_m_s / certificate.speed_ratio
    game, _ = game_played(settings, bound_m_s, certificate.evader_age_s)
    # A straight run does not depend on the target
    game = replace(game, target_velocity_m_s=(0.0, 0.0))
    return isochron(game, certificate.pursuer_game_m, certificate.evader_game_m, points)


def fence_edges(envelope: Envelope, home_m: Enu) -> list[FloatArray]:
    """The fence's edges as closed curves (n, 3), at the height of home."""
    edges = []
    if envelope.fence_radius_m is not None:
        edges.append(circle_points(home_m, envelope.fence_radius_m))
    if envelope.fence_polygon is not None:
        # North, east of home
        corners = np.array(envelope.fence_polygon.corners_ne_m)[:, ::-1] + np.array(home_m[:2])
        edges.append(np.concatenate([corners, corners[:1]]))
    return [lifted(edge, home_m[2]) for edge in edges]


_PURSUER: Final = {"r": 0.70, "g": 0.15, "b": 0.12, "a": 1.0}
_EVADER: Final = {"r": 0.04, "g": 0.37, "b": 0.65, "a": 1.0}
_MEETING: Final = {"r": 0.90, "g": 0.80, "b": 0.20, "a": 1.0}
_DISC: Final = {"r": 0.18, "g": 0.49, "b": 0.20, "a": 1.0}


def time_of(now_s: float) -> dict[str, int]:
    """Split seconds; viewers have no negative times, which become zero."""
    seconds, nanoseconds = divmod(max(0, round(now_s * 1e9)), 1_000_000_000)
    return {"sec": seconds, "nsec": nanoseconds}


def _vector(point_m: Sequence[float]) -> Json:
    return dict(zip("xyz", point_m, strict=True))


def _pose(point_m: Enu) -> Json:
    return {"position": _vector(point_m), "orientation": {**_vector(_ZERO), "w": 1.0}}


def _ball(centre_m: Enu, diameter_m: float, color: Json) -> Json:
    return {
        "pose": _pose(centre_m),
        "size": _vector((diameter_m, diameter_m, diameter_m)),
        "color": color,
    }


def _fix(now_s: float, name: str, position: Sequence[float], sd_m: float) -> Json:
    """A place on the map: latitude and longitude in degrees, altitude above mean sea level, left out if unknown."""
    if math.isnan(sd_m):
        variance = 0.0
        kind = _UNKNOWN
    else:
        variance = sd_m * sd_m
        kind = _DIAGONAL_KNOWN
    fix = {
        "timestamp": time_of(now_s),
        "frame_id": name,
        "latitude": position[0],
        "longitude": position[1],
    }
    if math.isfinite(position[2]):
        fix |= {"altitude": position[2]}
    covariance = [variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance]
    return fix | {"position_covariance": covariance, "position_covariance_type": kind}


def _pose_in_frame(now_s: float, point_m: Enu) -> Json:
    return {"timestamp": time_of(now_s), "frame_id": GAME_FRAME, "pose": _pose(point_m)}


def _scene(now_s: float, balls: Sequence[Json], rim: Sequence[Enu]) -> Json:
    # 2 pixels
    line: Json = {
        "type": _CLOSED_LINE,
        "pose": _pose(_ZERO),
        "thickness": 2.0,
        "scale_invariant": True,
    }
    line |= {
        "points": [_vector(corner) for corner in rim],
        "color": _DISC,
        "colors": [],
        "indices": [],
    }
    entity: Json = {
        "timestamp": time_of(now_s),
        "frame_id": GAME_FRAME,
        "id": "game",
        "lifetime": time_of(0.0),
    }
    entity |= {
        "frame_locked": False,
        "spheres": balls,
        "lines": [line],
        **dict.fromkeys(_UNUSED, ()),
    }
    return {"entities": [entity], "deletions": []}


def _schema_like(example: Any) -> Schema:  # noqa: ANN401 - any JSON
    """Describe a message by an example; a list that is always empty holds objects without fields."""
    if isinstance(example, dict):
        properties = {name: _schema_like(value) for name, value in example.items()}
        required = [name for name in properties if name != "altitude"]
        return {
            "type": "object",
            "properties": properties,
            "required": required,
            "additionalProperties": False,
        }
    if isinstance(example, (list, tuple)):
        return {"type": "array", "items": _schema_like(example[0] if example else {})}
    return {
        "type": {bool: "boolean", int: "integer", float: "number", str: "string"}[type(example)]
    }


def _shape(title: str, example: Json) -> Schema:
    return {"$schema": DIALECT, "title": title, **_schema_like(example)}


FIX: Final = _shape("foxglove.LocationFix", _fix(0.0, "", _ZERO, math.nan))
POSE: Final = _shape("foxglove.PoseInFrame", _pose_in_frame(0.0, _ZERO))
SCENE: Final = _shape("foxglove.SceneUpdate", _scene(0.0, [_ball(_ZERO, 1.0, _PURSUER)], [_ZERO]))


_Drawn = tuple[str, Schema, Json]
"""One message for viewers: topic, JSON Schema and content."""


class Scene:
    """Makes the messages of each cycle. It remembers when each topic was last drawn."""

    def __init__(self) -> None:
        self._drawn_s: dict[str, float] = {}

    def of(self, entry: CycleEntry) -> Iterator[_Drawn]:
        """Draw one cycle."""
        for message in entry.inputs.messages:
            if isinstance(message, GlobalPosition):
                yield from self._on_map("pursuer", message, math.nan)
        for report in entry.inputs.reports:
            if isinstance(report, EvaderReport):
                yield from self._on_map("evader", report, report.position_sd_m)
        now_s = entry.now_s
        certificate = entry.certificate
        if certificate is None:
            return
        pursuer = certificate.pursuer_game_m
        evader = certificate.evader_game_m
        if self._is_due("guidance/pose", now_s, POSE_EVERY_S):
            yield "guidance/pose/pursuer", POSE, _pose_in_frame(now_s, pursuer)
            yield "guidance/pose/evader", POSE, _pose_in_frame(now_s, evader)
        if self._is_due("guidance/scene", now_s, SCENE_EVERY_S):
            balls = [_ball(pursuer, 1.0, _PURSUER), _ball(evader, 1.0, _EVADER)]
            if not certificate.no_game:
                balls.append(_ball(certificate.meeting_point_game_m, 0.6, _MEETING))
            yield "guidance/scene", SCENE, _scene(now_s, balls, disc(certificate))

    def _on_map(
        self, name: str, message: GlobalPosition | EvaderReport, sd_m: float
    ) -> Iterator[_Drawn]:
        topic = f"guidance/map/{name}"
        if self._is_due(topic, message.received_s, POSE_EVERY_S):
            position = (message.latitude_deg, message.longitude_deg, message.altitude_amsl_m)
            yield topic, FIX, _fix(message.received_s, name, position, sd_m)

    def _is_due(self, topic: str, now_s: float, every_s: float) -> bool:
        # A tenth of a period early is accepted, since cycles do not fall on this grid.
        if now_s - self._drawn_s.get(topic, -math.inf) < 0.9 * every_s:
            return False
        self._drawn_s[topic] = now_s
        return True


_RIM: Final = [(float(x), float(y)) for x, y in circle_points((0.0, 0.0), 1.0, 37)[:-1]]
"""Corners of a rim of radius 1."""


def disc(certificate: Certificate) -> Sequence[Enu]:
    """Return corners of the rim of the stand-off disc, game frame, from the distances in the certificate."""
    evader = certificate.evader_game_m
    above = certificate.pursuer_game_m
    radius_m = math.dist(above[:2], evader[:2]) - certificate.gap_m
    height_m = above[2] - certificate.height_gap_m
    return [Enu((evader[0] + radius_m * x, evader[1] + radius_m * y, height_m)) for x, y in _RIM]
