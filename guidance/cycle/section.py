"""The section `[game]` of vehicle files: the game, its speeds and its target."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from guidance.config import AltitudeAmsl, Latitude, Longitude, Section, faults_of
from guidance.control import Speeds
from guidance.frames import Amsl, LocalFrame
from guidance.game import Extent
from guidance.game.rules import SpeedSetName
from guidance.strategies import COURSES, PURSUER_STRATEGIES
from guidance.strategies.own import as_one_text, is_own, policy_schema

_POLICIES: Final = [name for name in PURSUER_STRATEGIES if name not in COURSES]


def _known_policy(policy: str) -> str:
    if policy not in _POLICIES and not is_own(policy):
        raise ValueError(f"must be one of {', '.join(sorted(_POLICIES))}, or module:function")
    return policy


PolicyName = Annotated[
    str, BeforeValidator(as_one_text), AfterValidator(_known_policy), policy_schema(_POLICIES)
]


class TargetSection(Section):
    """The evader's target: a place, and possibly a shape about it. The place is the game frame's origin."""

    latitude_deg: Latitude = Field(description="north is positive")
    longitude_deg: Longitude = Field(description="east is positive")
    altitude_amsl_m: AltitudeAmsl = Field(
        0.0, description="information only: the game uses height differences"
    )
    polygon_deg: tuple[tuple[Latitude, Longitude], ...] = Field(
        (),
        description="latitude and longitude of the corners of a convex polygon, or of both ends of a line",
    )
    polygon_plan_file: Path | None = Field(
        None,
        description="a QGroundControl plan whose inclusion polygon is used instead; relative to this file",
    )
    radius_m: float = Field(
        0.0, ge=0.0, le=1000.0, description="what lies so near to place or polygon belongs to it"
    )

    @property
    def extent(self) -> Extent:
        """The shape about the place, x east and y north."""
        frame = LocalFrame(self.latitude_deg, self.longitude_deg, Amsl(0.0))
        places = [frame.ned_from_wgs84(*corner, frame.altitude) for corner in self.polygon_deg]
        if not places:
            return Extent(((0.0, 0.0),), self.radius_m)
        return Extent(tuple((east, north) for north, east, _ in places), self.radius_m)

    @model_validator(mode="before")
    @classmethod
    def _place_in_the_middle(cls, document: Any) -> Any:  # noqa: ANN401 - whatever a file holds
        """Without a place, take the middle of the corners."""
        corners = document.get("polygon_deg") if isinstance(document, dict) else None
        if not corners or {"latitude_deg", "longitude_deg"} & document.keys():
            return document
        middle = [sum(numbers) / len(corners) for numbers in zip(*corners, strict=True)]
        return {"latitude_deg": middle[0], "longitude_deg": middle[1], **document}

    def _faults(self) -> Iterator[str]:
        key = "game.target.polygon_deg, in metres east and north of the place"
        yield from faults_of(key, lambda: self.extent)


class GameSection(Section):
    """The game."""

    kind: Literal["pe", "tad"] = Field(
        "pe", description="pursuit-evasion, or target-attacker-defender"
    )
    speed_set: SpeedSetName = Field(
        "cylinder", description="one speed (ball), or own climb and descent rates"
    )
    speed_m_s: float = Field(
        gt=0.0, le=30.0, description="the pursuer's horizontal speed in the game"
    )
    climb_m_s: float = Field(1.5, gt=0.0, le=10.0, description="its climb rate")
    descent_m_s: float = Field(1.0, gt=0.0, le=10.0, description="its descent rate")
    policy: PolicyName = Field("optimal", description="the pursuer's strategy")
    navigation_gain: float = Field(
        3.0, ge=1.0, le=10.0, description="N of policy = proportional_navigation"
    )
    evader_speed_m_s: float = Field(gt=0.0, le=30.0, description="declared top speed of the evader")
    standoff_radius_m: float = Field(
        8.0, gt=0.0, le=200.0, description="radius of the disc around the evader"
    )
    standoff_height_m: float = Field(
        8.0, ge=2.0, le=120.0, description="height of the disc above the evader"
    )
    tolerance_m: float = Field(
        1.0, gt=0.0, le=10.0, description="distance from the disc that counts as capture"
    )
    target: TargetSection | None = Field(None, description="TAD: the evader's target")
    target_velocity_m_s: tuple[float, float] = Field(
        (0.0, 0.0),
        description="TAD: velocity of the target, east and north, constant from engagement",
    )

    @property
    def speeds(self) -> Speeds:
        """The pursuer's speeds in the game."""
        return Speeds(self.speed_m_s, self.climb_m_s, self.descent_m_s)

    def _faults(self) -> Iterator[str]:
        moves_m_s = math.hypot(*self.target_velocity_m_s)
        evader = f"game.evader_speed_m_s = {self.evader_speed_m_s:g}"
        if self.speed_m_s <= self.evader_speed_m_s:
            yield f"game.speed_m_s = {self.speed_m_s:g}: must be above {evader}; a slower pursuer is another game"
        if self.kind == "tad" and self.target is None:
            yield 'game.target: missing; kind = "tad" needs the latitude_deg and longitude_deg of the place to defend'
        if not moves_m_s < self.evader_speed_m_s or (moves_m_s > 0.0 and self.kind == "pe"):
            allowed = f'must be slower than {evader}, and only with kind = "tad"'
            yield f"game.target_velocity_m_s = {list(self.target_velocity_m_s)}: {allowed}"
        if self.kind == "pe" and self.target is not None:
            yield 'game.target: not allowed with kind = "pe"; use kind = "tad"'
