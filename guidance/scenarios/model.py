"""The scenario file: two players, a game and where it is flown. One file for mathematics and for flights.

Positions are in the game frame: x east, y north, z up, metres, about the site's point on the evader's plane.
"""

import math
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from guidance.config import Section, find, load

Point2 = tuple[float, float]
Point3 = tuple[float, float, float]


class Site(Section):
    """Where on Earth the game frame has its zero."""

    latitude_deg: float = Field(47.397742, ge=-85.0, le=85.0)
    longitude_deg: float = Field(8.545594, ge=-180.0, le=180.0)
    altitude_amsl_m: float = Field(488.0, ge=-500.0, le=6000.0)


class Pursuer(Section):
    """The vehicle that guidance flies."""

    position_m: Point3
    speed_m_s: float = Field(gt=0.0, le=30.0)
    speed_set: Literal["ball", "cylinder"] = "ball"
    climb_m_s: float = Field(3.0, gt=0.0, le=10.0)
    descent_m_s: float = Field(1.5, gt=0.0, le=10.0)
    policy: str = "optimal"
    autopilot: Literal["px4", "arducopter"] = "px4"
    takeoff_height_m: float = Field(10.0, ge=2.0, le=120.0)


class Evader(Section):
    """The cooperative target: a ground vehicle that plays the evader."""

    position_m: Point2
    height_m: float = Field(0.0, ge=0.0)
    speed_m_s: float = Field(gt=0.0, le=30.0)
    policy: str = "optimal"


class Target(Section):
    """The place the evader wants to reach."""

    position_m: Point2


class Standoff(Section):
    """The terminal set: the disc of this radius around the evader, at this height above the ground."""

    radius_m: float = Field(3.0, gt=0.0, le=100.0)
    height_m: float = Field(5.0, ge=2.0, le=120.0)
    tolerance_m: float = Field(0.5, gt=0.0, le=5.0)


class Envelope(Section):
    """What the flight never leaves, about the site."""

    fence_radius_m: float = Field(300.0, gt=10.0)
    ceiling_m: float = Field(120.0, gt=5.0)
    floor_m: float = Field(3.0, ge=1.0)


class Scenario(Section):
    """A whole scenario file."""

    title: str
    description: str = ""
    game: Literal["pe", "tad"]
    pursuer: Pursuer
    evader: Evader
    target: Target | None = None
    standoff: Standoff = Standoff()
    envelope: Envelope = Envelope()
    site: Site = Site()
    seed: int = Field(0, ge=0)
    time_limit_s: float = Field(300.0, gt=0.0, description="of the game itself, from engagement")
    hold_s: float = Field(3.0, ge=0.0, description="on station before landing")

    @model_validator(mode="after")
    def _check_players(self) -> Self:
        ratio = self.pursuer.speed_m_s / self.evader.speed_m_s
        if ratio <= 1.0:
            raise ValueError(
                f"speed ratio pursuer.speed_m_s / evader.speed_m_s = {self.pursuer.speed_m_s:g} / "
                f"{self.evader.speed_m_s:g} = {ratio:.3g}: must be above 1; a slower pursuer is another game"
            )
        if self.evader.height_m >= self.standoff.height_m:
            raise ValueError(
                f"evader.height_m = {self.evader.height_m:g}: must be below standoff.height_m = "
                f"{self.standoff.height_m:g}, the height the pursuer never goes below"
            )
        if self.game == "tad" and self.target is None:
            raise ValueError('target.position_m: missing; game = "tad" needs the place the evader wants to reach')
        if self.game == "pe" and self.target is not None:
            raise ValueError('target: not allowed with game = "pe"; use game = "tad"')
        return self

    @model_validator(mode="after")
    def _check_places(self) -> Self:
        x, y, z = self.pursuer.position_m
        if not self.standoff.height_m <= z <= self.envelope.ceiling_m:
            raise ValueError(
                f"pursuer.position_m: height {z:g} m; allowed is standoff.height_m = {self.standoff.height_m:g} "
                f"to envelope.ceiling_m = {self.envelope.ceiling_m:g}"
            )
        if self.envelope.floor_m > self.standoff.height_m:
            raise ValueError(
                f"envelope.floor_m = {self.envelope.floor_m:g}: must not be above standoff.height_m = "
                f"{self.standoff.height_m:g}"
            )
        for name, (px, py) in (("pursuer", (x, y)), ("evader", self.evader.position_m)):
            if math.hypot(px, py) > self.envelope.fence_radius_m:
                raise ValueError(
                    f"{name}.position_m: {math.hypot(px, py):.0f} m from the site's point; allowed is "
                    f"envelope.fence_radius_m = {self.envelope.fence_radius_m:g}"
                )
        return self


def load_scenario(name: str) -> tuple[Path, Scenario]:
    """Read a scenario by path or by the name of one that comes with the package.

    Raises:
        ConfigError: If there is none, or a key is wrong.
    """
    path = find(name, "scenarios")
    return path, load(Scenario, path)
