"""A flight as viewers of records draw it unasked: both on the map, and the game in three dimensions."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from guidance.certificate import Certificate
from guidance.frames import Vector
from guidance.log import foxglove
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
    """One message for viewers: its topic, the name of its type, and itself."""

    topic: str
    type_name: str
    message: Any


TYPES: Final[Mapping[str, Any]] = {
    "foxglove.LocationFix": foxglove.LocationFix,
    "foxglove.PoseInFrame": foxglove.PoseInFrame,
    "foxglove.SceneUpdate": foxglove.SceneUpdate,
}


class Scene:
    """Makes the messages of each cycle. It remembers when each topic was last drawn."""

    def __init__(self) -> None:
        self._drawn_s: dict[str, float] = {}

    def of(self, row: Mapping[str, Any]) -> Iterator[Drawn]:
        """Draw one cycle's row as `linked_flight.row` lays it out; one read from JSON has little to draw."""
        inputs = row.get("inputs", {})
        for message in inputs.get("messages", ()):
            if message.get("kind") == GlobalPosition.__name__ and self._is_due(
                "guidance/map/pursuer", message["received_s"]
            ):
                yield _vehicle(message)
        for report in inputs.get("reports", ()):
            if isinstance(report, EvaderReport) and self._is_due("guidance/map/evader", report.received_s):
                yield _evader(report)
        certificate = row.get("certificate")
        if not isinstance(certificate, Certificate):
            return
        now_s = row["now_s"]
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


def _vehicle(said: Mapping[str, Any]) -> Drawn:
    place = (said["latitude_deg"], said["longitude_deg"], said["altitude_amsl_m"])
    return Drawn("guidance/map/pursuer", "foxglove.LocationFix", foxglove.fix(said["received_s"], "pursuer", *place))


def _evader(said: EvaderReport) -> Drawn:
    place = (said.latitude_deg, said.longitude_deg, said.altitude_amsl_m)
    fix = foxglove.fix(said.received_s, "evader", *place, sd_m=said.position_sd_m)
    return Drawn("guidance/map/evader", "foxglove.LocationFix", fix)


def _poses(now_s: float, certificate: Certificate) -> Iterator[Drawn]:
    for name, place in (("pursuer", certificate.pursuer_game_m), ("evader", certificate.evader_game_m)):
        yield Drawn(f"guidance/pose/{name}", "foxglove.PoseInFrame", foxglove.pose(now_s, GAME_FRAME, place))


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
    return Drawn("guidance/scene", "foxglove.SceneUpdate", SceneUpdate((entity,)))


def disc(certificate: Certificate) -> Sequence[Vector]:
    """Corners of the stand-off disc's rim, game frame, as the certificate's distances to it have it."""
    (x, y, z), above = certificate.evader_game_m, certificate.pursuer_game_m
    radius_m = math.hypot(above[0] - x, above[1] - y) - certificate.gap_m
    height_m = above[2] - z - certificate.height_gap_m
    turns = (2.0 * math.pi * corner / _CORNERS for corner in range(_CORNERS))
    return [(x + radius_m * math.cos(turn), y + radius_m * math.sin(turn), z + height_m) for turn in turns]
