"""The scenario file: two players, a game and a site. The same file is computed or flown.

Positions are in the game frame: x east, y north, z up, in metres about the site, on the evader's plane.
"""

import itertools
import math
from collections.abc import Collection, Iterator, Sequence
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import BeforeValidator, ConfigDict, Field

from guidance.autopilots import AutopilotName
from guidance.config import Latitude, Longitude, Section, faults_of
from guidance.control import Limits, Speeds
from guidance.control.limits import AtLeast, AtMost
from guidance.game import Extent
from guidance.game.rules import SpeedSetName
from guidance.sim.expect import Expect
from guidance.strategies import EVADER_STRATEGIES, PURSUER_STRATEGIES
from guidance.strategies.own import as_one_text, is_own, policy_schema

Point2 = tuple[float, float]
Point3 = tuple[float, float, float]

PURSUER = "pursuer"
EVADER = "evader"
PURSUER_ID = 1
EVADER_ID = 2
"""Names and MAVLink system ids of the players of a scenario with one of each."""

FLOWN_SPEED_SET: Final = "cylinder"
MATHS_SPEED_SET: Final = "ball"
"""The speed set of a vehicle, where a scenario names none. An autopilot bounds climb and descent by themselves."""


PursuerPolicy = Annotated[str, BeforeValidator(as_one_text), policy_schema(PURSUER_STRATEGIES)]
EvaderPolicy = Annotated[str, BeforeValidator(as_one_text), policy_schema(EVADER_STRATEGIES)]

Speed = Annotated[float, Field(gt=0.0, le=30.0)]
SlowSpeed = Annotated[float, Field(gt=0.0, le=10.0)]
TakeoffHeight = Annotated[float, Field(ge=2.0, le=120.0)]

TrackRow = tuple[float, float, float, float]
"""Time in s, and x, y and z in m."""


class Site(Section):
    """The origin of the game frame on Earth."""

    latitude_deg: Latitude = Field(47.397742, description="north is positive")
    longitude_deg: Longitude = Field(8.545594, description="east is positive")
    altitude_amsl_m: float = Field(
        488.0, ge=-500.0, le=6000.0, description="of the evader's plane, above sea level"
    )

    def _faults(self) -> Iterator[str]:
        if self.latitude_deg == 0.0 == self.longitude_deg:
            yield (
                "site.latitude_deg = 0 and site.longitude_deg = 0: means that no position is known in MAVLink, and "
                "such reports are not used; choose another place, such as latitude_deg = 0.001"
            )


_TRACK_PART_S: Final = 10.0
_TRACK_NOISE_M: Final = 3.0
"""A recorded track is compared with the speed over such a time; its positions may be wrong by so much."""


class Player(Section):
    """Keys of both players: the policy, and the course that some policies follow."""

    policy: str = Field("optimal", description="the player's strategy")
    speed_m_s: Speed = Field(description="horizontal top speed")
    waypoints_m: tuple[Point3 | Point2, ...] = Field(
        (), description='of policy = "waypoints"; the last one ends it'
    )
    turn_every_s: float = Field(
        5.0, ge=0.5, description='with policy = "random_turns": time between turns'
    )
    turn_most_deg: float = Field(
        90.0, gt=0.0, le=180.0, description='with policy = "random_turns": largest turn'
    )
    circle_radius_m: float = Field(
        10.0, ge=1.0, le=1000.0, description='with policy = "circle": radius'
    )
    track: tuple[TrackRow, ...] = Field(
        (), description='of policy = "recorded": rows t, x, y, z, or a .csv or .mcap'
    )

    def _faults(self) -> Iterator[str]:
        for policy, key in (("waypoints", "waypoints_m"), ("recorded", "track")):
            is_set = bool(getattr(self, key))
            if (self.policy == policy) != is_set:
                fault = (
                    f"{key}: {'not allowed' if is_set else 'missing'} with policy = {self.policy!r}"
                )
                yield f"{fault}; it is the course of policy = {policy!r}"
        times = [row[0] for row in self.track]
        if any(later <= sooner for sooner, later in itertools.pairwise(times)) or len(times) == 1:
            yield "track: needs at least two rows, with increasing times"
            return
        # The first part of the track that is too fast for the player.
        later = 0
        for row in self.track:
            while later < len(self.track) - 1 and self.track[later][0] - row[0] < _TRACK_PART_S:
                later += 1
            to_s = self.track[later][0]
            duration_s = to_s - row[0]
            way_m = math.dist(row[1:3], self.track[later][1:3])
            if way_m > self.speed_m_s * duration_s + _TRACK_NOISE_M:
                yield (
                    f"track: from {row[0]:g} to {to_s:g} s it needs {way_m / duration_s:.3g} m/s, but speed_m_s = "
                    f"{self.speed_m_s:g}; raise speed_m_s, or the track would not be followed"
                )
                return


class Pursuer(Player):
    """The vehicle that the guidance flies."""

    policy: PursuerPolicy = Field(
        "optimal",
        description="the pursuer's policy; or module:function or file.py:function, your own code, run as yours",
    )
    position_m: Point3 = Field(description="start of the game: x east, y north, z up")
    speed_m_s: Speed = Field(description="horizontal speed in the game")
    speed_set: SpeedSetName | None = Field(
        None,
        description="ball: one speed in every direction; cylinder: own climb and descent rates; "
        "default: ball in mathematics, and in flight the vehicle's own, cylinder",
    )
    climb_m_s: SlowSpeed = Field(3.0, description="climb rate, with the cylinder")
    descent_m_s: SlowSpeed = Field(1.5, description="descent rate, with the cylinder")
    navigation_gain: float = Field(
        3.0, ge=1.0, le=10.0, description='N of policy = "proportional_navigation"'
    )
    autopilot: AutopilotName = Field(
        "px4", description="the autopilot that the mock plays in a flight"
    )
    takeoff_height_m: TakeoffHeight = Field(10.0, description="above home")

    @property
    def speeds(self) -> Speeds:
        """The pursuer's speeds in the game."""
        return Speeds(self.speed_m_s, self.climb_m_s, self.descent_m_s)


class Evader(Player):
    """The cooperative evader, a ground vehicle."""

    policy: EvaderPolicy = Field(
        "optimal", description="the evader's policy; or your own code, as the pursuer's"
    )
    position_m: Point2 = Field(description="start of the game: x east, y north")
    height_m: float = Field(
        0.0, ge=0.0, description="height of the evader's antenna above its plane"
    )
    speed_m_s: Speed = Field(description="its top speed")
    declared_speed_m_s: Speed | None = Field(
        None, description="top speed that it declares; default: speed_m_s"
    )
    acceleration_m_s2: float | None = Field(
        None, gt=0.0, le=10.0, description="of the mocked rover; default: its own"
    )

    @property
    def believed_speed_m_s(self) -> float:
        """The top speed that the pursuer assumes."""
        return self.speed_m_s if self.declared_speed_m_s is None else self.declared_speed_m_s


class Target(Section):
    """The evader's target: a place, and possibly a shape about it."""

    position_m: Point2 = Field(description="x east, y north")
    polygon_m: tuple[Point2, ...] = Field(
        (),
        description="corners of a convex polygon, or both ends of a line, from position_m; default: the place",
    )
    radius_m: float = Field(
        0.0, ge=0.0, le=1000.0, description="what lies so near to place or polygon belongs to it"
    )

    @property
    def extent(self) -> Extent:
        """The shape about the place."""
        return Extent(self.polygon_m or ((0.0, 0.0),), self.radius_m)

    def _faults(self) -> Iterator[str]:
        yield from faults_of(f"target.polygon_m = {self.polygon_m}", lambda: self.extent)


class Standoff(Section):
    """The terminal set: a disc around the evader, at a height above the ground."""

    radius_m: float = Field(3.0, gt=0.0, le=100.0, description="radius R of the disc")
    height_m: float = Field(
        5.0, ge=2.0, le=120.0, description="height h of the disc above the ground"
    )
    tolerance_m: float = Field(
        0.5, gt=0.0, le=5.0, description="distance from the disc that counts as capture"
    )


class ScenarioLimits(Limits):
    """Limits of a scenario: the vehicle file's keys with wider defaults, and without polygons."""

    floor_m: AtLeast = Field(3.0, ge=1.0, description="lowest height")
    ceiling_m: AtMost = Field(120.0, gt=5.0, description="greatest height")
    fence_radius_m: AtMost = Field(300.0, gt=10.0, description="greatest distance from home")

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        for key in ("fence_polygon_ne_m", "fence_polygon_deg", "fence_plan_file"):
            if getattr(self, key) is not None:
                yield f"limits.{key}: not allowed in a scenario; give it in the vehicle file"


class Sensor(Section):
    """How reports of the evader reach the pursuer after engagement, in mathematics and in flights."""

    rate_hz: float | None = Field(
        None, gt=0.0, le=50.0, description="report rate; default: the source's own rate"
    )
    latency_s: float = Field(0.0, ge=0.0, le=5.0, description="from measurement to arrival")
    position_noise_m: float = Field(
        0.0, ge=0.0, le=50.0, description="standard deviation of each coordinate"
    )
    velocity_noise_m_s: float = Field(
        0.0, ge=0.0, le=10.0, description="standard deviation of each component"
    )
    dropout: float = Field(0.0, ge=0.0, lt=1.0, description="share of lost reports")
    outages_s: tuple[tuple[float, float], ...] = Field(
        (), description="[from, to] after engagement without a report"
    )

    def _faults(self) -> Iterator[str]:
        for begin, end in self.outages_s:
            if not 0.0 <= begin < end:
                yield f"outages_s: [{begin:g}, {end:g}]: must be [from, to] with 0 <= from < to"


class Wind(Section):
    """The wind. It moves the pursuer, not the evader. Mathematics and flights play different games in wind.

    In mathematics, the pursuer's speed is an airspeed and both players know the wind. In flight, the autopilot holds
    the ground speed against the wind, and neither player knows it: they play the game of still air.
    """

    velocity_m_s: Point2 = Field(
        (0.0, 0.0),
        description="velocity of the air, x east, y north; in mathematics it carries the pursuer and both players "
        "know it, in flight the autopilot holds the speed over the ground against it and the game is that of still air",
    )


WIND_WORDS: Final = (
    "in mathematics it carries the pursuer and both players know it; "
    "in flight no player knows it, and the game is that of still air"
)
"""The games that are played in wind, in words."""


class Fault(Section):
    """A fault in a mocked flight: a kind from `sitl-mock list faults` with its keys."""

    model_config = ConfigDict(extra="allow")

    kind: str = Field(description="a name from `sitl-mock list faults`")
    vehicle: Literal["pursuer", "evader"] = Field("pursuer", description="the affected vehicle")
    after: Literal["engaged", "start"] = Field(
        "engaged", description="the moment from which at_s counts"
    )
    at_s: Annotated[float, Field(ge=0.0)] = Field(0.0, description="start of the fault")
    for_s: Annotated[float, Field(gt=0.0)] | None = Field(
        None, description="duration; default: until the end"
    )


class AnyScenario(Section):
    """The keys that a scenario of two players and one of teams share."""

    title: str = Field(description="a few words")
    description: str = Field("", description="purpose and choices of the scenario")
    game: Literal["pe", "tad"] = Field(description="pursuit-evasion, or target-attacker-defender")
    target: Target | None = Field(None, description='with game = "tad"')
    seed: int = Field(0, ge=0, description="seed of all random numbers")
    time_limit_s: float = Field(300.0, gt=0.0, description="longest game, from engagement")

    def _shared_faults(self, own: Collection[str], **policies: Collection[str]) -> Iterator[str]:
        """Yield the faults in the keys of both kinds, given the policies that each player may have.

        Args:
            own: The players that may have a user's policy.
            policies: Names by the player.
        """
        if self.game == "tad" and self.target is None:
            yield 'target.position_m: missing; game = "tad" needs a target'
        if self.game == "pe" and self.target is not None:
            yield 'target: not allowed with game = "pe"; use game = "tad"'
        for player, allowed in policies.items():
            section = getattr(self, player)
            may_be_own = player in own
            if isinstance(section, tuple):
                named = {f"{player}[{number}]": group for number, group in enumerate(section)}
            else:
                named = {player: section}
            for key, group in named.items():
                if group.policy not in allowed and not (may_be_own and is_own(group.policy)):
                    own_words = (
                        ", and your own: module:function or file.py:function" if may_be_own else ""
                    )
                    yield f"{key}.policy = {group.policy!r}: allowed are {', '.join(allowed)}{own_words}"
                if group.policy == "task_oriented" and self.target is None:
                    yield f"{key}.policy = {group.policy!r}: needs target.position_m"


class Scenario(AnyScenario):
    """A whole scenario file."""

    pursuer: Pursuer
    evader: Evader
    standoff: Standoff = Standoff()
    sensor: Sensor = Sensor()
    wind: Wind = Wind()
    fault: tuple[Fault, ...] = Field((), description="faults of a mocked flight")
    expect: Expect = Expect()
    limits: ScenarioLimits = ScenarioLimits()
    site: Site = Site()
    hold_s: float = Field(3.0, ge=0.0, description="time on station before landing")

    @property
    def home_m(self) -> Point2:
        """The pursuer's take-off place, 2 m south of its start."""
        x, y, _ = self.pursuer.position_m
        return (x, y - 2.0)

    def as_flown(self) -> "Scenario":
        """Return the scenario whose game flights play: in still air, with the vehicle's speed set by default."""
        pursuer = self.pursuer
        speed_set = FLOWN_SPEED_SET if pursuer.speed_set is None else pursuer.speed_set
        return self.model_copy(
            update={"wind": Wind(), "pursuer": pursuer.model_copy(update={"speed_set": speed_set})}
        )

    @property
    def speed_limits(self) -> Speeds:
        """Speed limits of every command to the pursuer."""
        return self.limits.speeds(self.pursuer.speeds, section="pursuer")

    def _faults(self) -> Iterator[str]:
        yield from self._shared_faults(
            (PURSUER, EVADER), pursuer=PURSUER_STRATEGIES, evader=EVADER_STRATEGIES
        )
        _ = self.speed_limits
        wind_m_s = math.hypot(*self.wind.velocity_m_s)
        evader = self.evader
        u = self.pursuer.speed_m_s
        for key, v in (
            ("speed_m_s", evader.speed_m_s),
            ("declared_speed_m_s", evader.believed_speed_m_s),
        ):
            if u <= v + wind_m_s:
                wind = f" with {wind_m_s:g} m/s of wind" if wind_m_s else ""
                ratio = f"speed ratio pursuer.speed_m_s / evader.{key} = {u:g} / {v:g} = {u / v:.3g}{wind}"
                allowed = "must be above 1, with the wind added to the evader's speed"
                yield f"{ratio}: {allowed}; a slower pursuer is another game"
        if evader.height_m >= self.standoff.height_m:
            lowest = f"standoff.height_m = {self.standoff.height_m:g}, the pursuer's lowest height"
            yield f"evader.height_m = {evader.height_m:g}: must be below {lowest}"
        if any(len(point) == 2 for point in self.pursuer.waypoints_m):
            yield "pursuer.waypoints_m: every point needs x, y and z"
        for part in (self.expect, self.expect.maths, self.expect.flown):
            yield from part.contradictions(self.game)
        z = self.pursuer.position_m[2]
        lowest_m = self.standoff.height_m
        limits = self.limits
        if not lowest_m <= z <= limits.ceiling_m:
            allowed = f"standoff.height_m = {lowest_m:g} to limits.ceiling_m = {limits.ceiling_m:g}"
            yield f"pursuer.position_m: height {z:g} m; allowed is {allowed}"
        if limits.floor_m > lowest_m:
            yield f"limits.floor_m = {limits.floor_m:g}: must not be above standoff.height_m = {lowest_m:g}"
        out_m = math.dist(self.evader.position_m, self.home_m)
        if out_m > limits.fence_radius_m:
            allowed = f"allowed is limits.fence_radius_m = {limits.fence_radius_m:g}"
            yield f"evader.position_m: {out_m:.0f} m from the pursuer's home; {allowed}"


class Pursuit(NamedTuple):
    """One vehicle of a flight, the evader that it pursues, and the game of the two. Both names are unique.

    All pursuits of a flight have the same site and seed. If several pursue one evader, the first describes it.
    """

    scenario: Scenario
    vehicle: str = PURSUER
    evader: str = EVADER


Flown = Scenario | Sequence[Pursuit]
"""The flight: one scenario with its two players, or several pursuits at the same time."""


def pursuits_of(scenario: Flown) -> Sequence[Pursuit]:
    """Return the pursuits of a flight; a scenario is one."""
    if isinstance(scenario, Scenario):
        return (Pursuit(scenario),)
    return scenario
