"""The scenario file: two players, a game and where it is flown. One file for mathematics and for flights.

Positions are in the game frame: x east, y north, z up, metres, about the site's point on the evader's plane.
"""

import itertools
import math
from typing import Annotated, Any, Final, Literal, Self

from pydantic import ConfigDict, Field, WithJsonSchema, model_validator

from guidance.config import Latitude, Longitude, Section
from guidance.control import SpeedLimits, Speeds
from guidance.sim.expect import Expect
from guidance.strategies import EVADER_STRATEGIES, PURSUER_STRATEGIES

Point2 = tuple[float, float]
Point3 = tuple[float, float, float]

PURSUER, EVADER = "pursuer", "evader"
PURSUER_ID, EVADER_ID = 1, 2
"""MAVLink system ids of the players."""

BESIDE_M: Final = 2.0
"""How far beside its start the pursuer takes off."""

PursuerPolicy = Annotated[str, WithJsonSchema({"type": "string", "enum": [*PURSUER_STRATEGIES]})]
EvaderPolicy = Annotated[str, WithJsonSchema({"type": "string", "enum": [*EVADER_STRATEGIES]})]

TrackRow = tuple[float, float, float, float]
"""Time in s, and x, y and z in m."""


class Site(Section):
    """Where on Earth the game frame has its zero."""

    latitude_deg: Latitude = Field(47.397742, description="north is positive")
    longitude_deg: Longitude = Field(8.545594, description="east is positive")
    altitude_amsl_m: float = Field(488.0, ge=-500.0, le=6000.0, description="of the evader's plane, above sea level")


class Player(Section):
    """What both players share: how they play, where that is a course."""

    policy: str = Field("optimal", description="what is played")
    waypoints_m: tuple[Point3 | Point2, ...] = Field((), description='of policy = "waypoints"; then the player stays')
    turn_every_s: float = Field(5.0, ge=0.5, description='of policy = "random_turns": how often it turns')
    turn_most_deg: float = Field(90.0, gt=0.0, le=180.0, description="largest turn at a time")
    track: tuple[TrackRow, ...] = Field(
        (), description='of policy = "recorded": rows of t, x, y, z, or in a file the path of a .csv or .mcap'
    )

    @model_validator(mode="after")
    def _check_course(self) -> Self:
        for policy, key in (("waypoints", "waypoints_m"), ("recorded", "track")):
            given = bool(getattr(self, key))
            if (self.policy == policy) != given:
                raise ValueError(
                    f"{key}: {'missing' if not given else 'not allowed'} with policy = {self.policy!r}; "
                    f"it says where policy = {policy!r} goes"
                )
        times = [row[0] for row in self.track]
        if any(later <= sooner for sooner, later in itertools.pairwise(times)) or len(times) == 1:
            raise ValueError("track: needs two rows at least, with times that rise from row to row")
        return self


class Pursuer(Player):
    """The vehicle that guidance flies."""

    policy: PursuerPolicy = Field("optimal", description="what it plays")
    position_m: Point3 = Field(description="where the game begins: x east, y north, z up")
    speed_m_s: float = Field(gt=0.0, le=30.0, description="level speed that the game is played with")
    speed_set: Literal["ball", "cylinder"] = Field(
        "ball", description="one speed in all directions (the paper's), or level, up and down apart"
    )
    climb_m_s: float = Field(3.0, gt=0.0, le=10.0, description="and upwards, of the cylinder")
    descent_m_s: float = Field(1.5, gt=0.0, le=10.0, description="and downwards, of the cylinder")
    navigation_gain: float = Field(3.0, ge=1.0, le=10.0, description='N of policy = "proportional_navigation"')
    autopilot: Literal["px4", "arducopter"] = Field("px4", description="which one the mock plays in a flight")
    takeoff_height_m: float = Field(10.0, ge=2.0, le=120.0, description="above home")

    @property
    def speeds(self) -> Speeds:
        """What the game is played with."""
        return Speeds(self.speed_m_s, self.climb_m_s, self.descent_m_s)


class Evader(Player):
    """The cooperative evader: a ground vehicle that plays the evader."""

    policy: EvaderPolicy = Field("optimal", description="what it plays")
    position_m: Point2 = Field(description="where the game begins: x east, y north")
    height_m: float = Field(0.0, ge=0.0, description="of the evader's own antenna above its plane")
    speed_m_s: float = Field(gt=0.0, le=30.0, description="that it has")
    declared_speed_m_s: float | None = Field(
        None, gt=0.0, le=30.0, description="that it says it has, which the pursuer believes; speed_m_s if not given"
    )

    @property
    def believed_speed_m_s(self) -> float:
        """The bound on the evader's speed that the pursuer plays against."""
        return self.speed_m_s if self.declared_speed_m_s is None else self.declared_speed_m_s


class Target(Section):
    """The place the evader wants to reach."""

    position_m: Point2 = Field(description="x east, y north")


class Standoff(Section):
    """The terminal set: the disc of this radius around the evader, at this height above the ground."""

    radius_m: float = Field(3.0, gt=0.0, le=100.0, description="R, about the evader")
    height_m: float = Field(5.0, ge=2.0, le=120.0, description="h, above the ground")
    tolerance_m: float = Field(0.5, gt=0.0, le=5.0, description="distance from the disc that counts as captured")


class Limits(SpeedLimits):
    """What the flight never leaves: heights above the site, a circle about home (`Scenario.home_m`), and speeds."""

    fence_radius_m: float = Field(300.0, gt=10.0, description="greatest distance from home")
    ceiling_m: float = Field(120.0, gt=5.0, description="greatest height")
    floor_m: float = Field(3.0, ge=1.0, description="lowest height")


class Sensor(Section):
    """How the pursuer hears of the evader from engagement on: reports of position and velocity, in all worlds alike."""

    rate_hz: float | None = Field(None, gt=0.0, le=50.0, description="of reports; as they come if not given")
    latency_s: float = Field(0.0, ge=0.0, le=5.0, description="from measurement to arrival")
    position_noise_m: float = Field(0.0, ge=0.0, le=50.0, description="standard deviation of each coordinate")
    velocity_noise_m_s: float = Field(0.0, ge=0.0, le=10.0, description="standard deviation of each component")
    dropout: float = Field(0.0, ge=0.0, lt=1.0, description="share of reports that never arrive")
    outages_s: tuple[tuple[float, float], ...] = Field(
        (), description="from when to when, after engagement, nothing arrives"
    )

    @model_validator(mode="after")
    def _check_outages(self) -> Self:
        for begin, end in self.outages_s:
            if not 0.0 <= begin < end:
                raise ValueError(f"outages_s: [{begin:g}, {end:g}]: must be [from, to] with 0 <= from < to")
        return self


class Wind(Section):
    """The air's velocity, x east and y north. It moves the pursuer and not the evader.

    In mathematics it carries the pursuer, whose speed is then an airspeed, and both players know of it. In flight it
    blows on the vehicle, whose autopilot holds the speed over ground against it, and nobody is told.
    """

    velocity_m_s: Point2 = Field((0.0, 0.0), description="x east, y north: where the air goes to")


class Fault(Section):
    """What goes wrong in a mocked flight: a fault of `sitl-mock list faults`, with its keys."""

    model_config = ConfigDict(extra="allow")

    kind: str = Field(description="as `sitl-mock list faults` names it")
    vehicle: Literal["pursuer", "evader"] = Field("pursuer", description="whose")
    after: Literal["engaged", "start"] = Field("engaged", description="what at_s counts from")
    at_s: Annotated[float, Field(ge=0.0)] = Field(0.0, description="when it begins")
    for_s: Annotated[float, Field(gt=0.0)] | None = Field(None, description="how long it lasts; for good if not given")

    def keys(self) -> dict[str, Any]:
        """The keys that belong to the kind."""
        return dict(self.model_extra or {})


class Scenario(Section):
    """A whole scenario file."""

    title: str = Field(description="a few words")
    description: str = Field("", description="what it shows, and why it is as it is")
    game: Literal["pe", "tad"] = Field(description="pursuit-evasion, or target-attacker-defender")
    pursuer: Pursuer
    evader: Evader
    target: Target | None = Field(None, description='with game = "tad"')
    standoff: Standoff = Standoff()
    sensor: Sensor = Sensor()
    wind: Wind = Wind()
    fault: tuple[Fault, ...] = Field((), description="what goes wrong in a mocked flight")
    expect: Expect = Expect()
    limits: Limits = Limits()
    site: Site = Site()
    seed: int = Field(0, ge=0, description="of all that is random")
    time_limit_s: float = Field(300.0, gt=0.0, description="of the game itself, from engagement")
    hold_s: float = Field(3.0, ge=0.0, description="on station before landing")

    @property
    def home_m(self) -> Point2:
        """Where the pursuer takes off: south of its start, so that it has somewhere to fly to."""
        x, y, _ = self.pursuer.position_m
        return (x, y - BESIDE_M)

    @property
    def speed_limits(self) -> Speeds:
        """What no command to the pursuer exceeds."""
        return self.limits.speeds(self.pursuer.speeds, section="pursuer")

    @model_validator(mode="after")
    def _check_players(self) -> Self:
        _ = self.speed_limits
        wind_m_s = math.hypot(*self.wind.velocity_m_s)
        evader = self.evader
        for key, speed_m_s in (("speed_m_s", evader.speed_m_s), ("declared_speed_m_s", evader.believed_speed_m_s)):
            if self.pursuer.speed_m_s <= speed_m_s + wind_m_s:
                raise ValueError(
                    f"speed ratio pursuer.speed_m_s / evader.{key} = {self.pursuer.speed_m_s:g} / {speed_m_s:g} = "
                    f"{self.pursuer.speed_m_s / speed_m_s:.3g}{f' with {wind_m_s:g} m/s of wind' if wind_m_s else ''}: "
                    "must be above 1, with the wind added to the evader's; a slower pursuer is another game"
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
    def _check_policies(self) -> Self:
        known = {"pursuer": PURSUER_STRATEGIES, "evader": EVADER_STRATEGIES}
        for player, names in known.items():
            policy = getattr(self, player).policy
            if policy not in names:
                raise ValueError(f"{player}.policy = {policy!r}: allowed are {', '.join(names)}")
            if policy == "task_oriented" and self.target is None:
                raise ValueError(f"{player}.policy = {policy!r}: needs target.position_m, the place to go to")
        if any(len(point) == 2 for point in self.pursuer.waypoints_m):
            raise ValueError("pursuer.waypoints_m: every point needs x, y and z")
        self.expect.check_all(self.game)
        return self

    @model_validator(mode="after")
    def _check_places(self) -> Self:
        z = self.pursuer.position_m[2]
        if not self.standoff.height_m <= z <= self.limits.ceiling_m:
            raise ValueError(
                f"pursuer.position_m: height {z:g} m; allowed is standoff.height_m = {self.standoff.height_m:g} "
                f"to limits.ceiling_m = {self.limits.ceiling_m:g}"
            )
        if self.limits.floor_m > self.standoff.height_m:
            raise ValueError(
                f"limits.floor_m = {self.limits.floor_m:g}: must not be above standoff.height_m = "
                f"{self.standoff.height_m:g}"
            )
        out_m = math.dist(self.evader.position_m, self.home_m)
        if out_m > self.limits.fence_radius_m:
            raise ValueError(
                f"evader.position_m: {out_m:.0f} m from the pursuer's home; allowed is limits.fence_radius_m = "
                f"{self.limits.fence_radius_m:g}"
            )
        return self
