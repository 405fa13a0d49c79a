"""A flight as viewers of records draw it unasked: both on the map, and the game in three dimensions."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

from guidance.certificate import Certificate
from guidance.frames import Vector
from guidance.log import foxglove
from guidance.log.codec import Codec
from guidance.log.entries import CycleEntry
from guidance.log.foxglove import Color, SceneEntity, SceneUpdate, Time
from guidance.messages import EvaderReport, GlobalPosition

EVERY_S: Final = 0.1
SCENE_EVERY_S: Final = 0.2
"""A map and a scene are looked at: ten and five times a second are enough."""

GAME_FRAME: Final = "game"

_PURSUER: Final = Color(0.70, 0.15, 0.12)
_EVADER: Final = Color(0.04, 0.37, 0.65)
_MEETING: Final = Color(0.90, 0.80, 0.20)
_DISC: Final = Color(0.18, 0.49, 0.20)
_CORNERS: Final = 36


class Drawn(NamedTuple):
    """One message for viewers: its topic, what writes it, and itself."""

    topic: str
    codec: Codec[Any]
    message: Any


_FIX: Final = Codec("foxglove.LocationFix", foxglove.LocationFix)
_POSE: Final = Codec("foxglove.PoseInFrame", foxglove.PoseInFrame)
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
    return Drawn(f"guidance/map/{name}", _FIX, foxglove.fix(said.received_s, name, *place, sd_m=sd_m))


def _poses(now_s: float, certificate: Certificate) -> Iterator[Drawn]:
    for name, place in (("pursuer", certificate.pursuer_game_m), ("evader", certificate.evader_game_m)):
        yield Drawn(f"guidance/pose/{name}", _POSE, foxglove.pose(now_s, GAME_FRAME, place))


def _game(now_s: float, certificate: Certificate) -> Drawn:
    pursuer, evader = certificate.pursuer_game_m, certificate.evader_game_m
    spheres = [foxglove.ball(pursuer, 1.0, _PURSUER), foxglove.ball(evader, 1.0, _EVADER)]
    if not certificate.no_game:
        spheres.append(foxglove.ball(certificate.meeting_point_game_m, 0.6, _MEETING))
    entity = SceneEntity(
        foxglove.time_of(now_s),
        GAME_FRAME,
        "game",
        Time(0, 0),
        frame_locked=False,
        spheres=tuple(spheres),
        lines=(foxglove.ring(tuple(disc(certificate)), _DISC),),
    )
    return Drawn("guidance/scene", _SCENE, SceneUpdate((entity,)))


def disc(certificate: Certificate) -> Sequence[Vector]:
    """Corners of the stand-off disc's rim, game frame, as the certificate's distances to it have it."""
    (x, y, z), above = certificate.evader_game_m, certificate.pursuer_game_m
    radius_m = math.hypot(above[0] - x, above[1] - y) - certificate.gap_m
    height_m = above[2] - z - certificate.height_gap_m
    turns = (2.0 * math.pi * corner / _CORNERS for corner in range(_CORNERS))
    return [(x + radius_m * math.cos(turn), y + radius_m * math.sin(turn), z + height_m) for turn in turns]
