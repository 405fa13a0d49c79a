"""Random TAD games in virtual time, from hover, with wind. The evader has full speed at once; both players can win.

The target is a point, or a disc, a segment, a polygon, or a point that moves (`SHAPES`). An evader that runs to a
target with a shape may feint: it runs to a place before another part of the shape first.

The flight to each start is flown once and copied for every game.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from random import Random
from typing import NamedTuple

from guidance.cycle import Certificate, CycleSettings, Violation
from guidance.cycle.monitor import GUARDED_S, LASTING_S
from guidance.flight import Event, FlightSettings, Outputs, State
from guidance.frames import Enu
from guidance.game import Extent, Winner, solve_state
from guidance.game.arrays import FLOATS
from guidance.game.extent import to_set
from guidance.game.meeting_times import catch_in_ball
from guidance.session.fly.loop import PERIOD_S
from guidance.session.plan import plan_of
from guidance.sim.scenario import Scenario, Target
from tests.harness.chase import Chase, hover_chase
from tests.harness.copies import Flown

LONGEST_S = 60.0
SETTLED_S = 6.0
HEARD_S = 2.0
"""Time from the evader's first report to the order to engage."""


Point = tuple[float, float]


class Aim(NamedTuple):
    """The target's shape about the origin of the game frame, and its velocity, m/s east and north."""

    corners_m: tuple[Point, ...] = ()
    radius_m: float = 0.0
    velocity_m_s: Point = (0.0, 0.0)


SHAPES: Mapping[str, tuple[Aim, ...]] = {
    "point": (Aim(),),
    "disc": (Aim(radius_m=15.0), Aim(radius_m=6.0), Aim(radius_m=10.0), Aim(radius_m=25.0)),
    "segment": (
        Aim(((-20.0, 0.0), (20.0, 0.0))),
        Aim(((-6.0, -8.0), (6.0, 8.0))),
        Aim(((-10.0, 10.0), (10.0, -10.0)), 2.0),
    ),
    "polygon": (
        Aim(((-20.0, -10.0), (20.0, -10.0), (20.0, 10.0), (-20.0, 10.0))),
        Aim(((-8.0, -6.0), (8.0, -6.0), (0.0, 9.0))),
    ),
    "moving": (
        Aim(velocity_m_s=(-0.4, 0.4)),
        Aim(velocity_m_s=(1.0, 0.0)),
        Aim(velocity_m_s=(0.0, -0.8)),
    ),
    "moving disc": (
        Aim(radius_m=10.0, velocity_m_s=(-0.4, 0.4)),
        Aim(radius_m=6.0, velocity_m_s=(1.0, 0.0)),
        Aim(radius_m=20.0, velocity_m_s=(0.0, -0.8)),
    ),
}
"""Targets of the games, by the name of a kind."""


class GameState(NamedTuple):
    """Positions and velocities of a vehicle and an evader, game frame, m and m/s."""

    pursuer_m: Enu
    pursuer_m_s: Enu
    evader_m: Enu
    evader_m_s: Enu
    target_m: Enu | None


Evader = Callable[[GameState, float, Enu], Point]
"""An evader: its velocity, x and y, from the game's state, the time, and where the ideal game ends."""


class Setup(NamedTuple):
    """Settings shared by all games from one start."""

    autopilot: str
    speeds_m_s: tuple[float, float]
    start_m: tuple[float, float, float]
    aim: Aim = Aim()
    policy: str = "optimal"


SETUPS = tuple(
    Setup(autopilot, speeds, start)
    for speeds, start in (
        ((6.0, 3.0), (0.0, 20.0, 20.0)),
        ((6.0, 2.0), (0.0, 60.0, 15.0)),
        ((8.0, 4.0), (0.0, 45.0, 20.0)),
        ((5.0, 3.5), (0.0, 30.0, 15.0)),
        ((8.0, 3.0), (0.0, 90.0, 25.0)),
        ((6.0, 4.0), (0.0, 10.0, 12.0)),
    )
    for autopilot in ("px4", "arducopter")
)


class Drawn(NamedTuple):
    """One game.

    Attributes:
        number: Number of the game; seeds its noise.
        setup: Autopilot, speeds and start of the pursuer.
        evader_m: Start of the evader, x and y.
        course_m: Waypoints of the evader, a point of the target last, where it is at engagement; empty if it plays the
            game's optimal strategy.
        wind_m_s: Wind velocity, north and east.
    """

    number: int
    setup: Setup
    evader_m: tuple[float, float]
    course_m: tuple[tuple[float, float], ...]
    wind_m_s: tuple[float, float]


class Guarded(NamedTuple):
    """End of one game, and the vehicle's verdicts during it.

    Attributes:
        end: "captured", "arrived" or another event; "undecided" after `LONGEST_S`.
        end_s: Time of the end since engagement.
        margin_s: The ideal game's margin at engagement.
        claimed_s: Time when the verdict "pursuer" first lasted `LASTING_S`; NaN if never.
        reported_s: Time of the event that reports this verdict; NaN if never.
        sustained_s: Time when the verdict "pursuer" first lasted `GUARDED_S`; NaN if never.
        was_certain: Of a capture without a verdict: whether the vehicle could have been certain of it. The referee
            tries other evaders from the same states (`tests.harness.trials`); without a trial it counts as certain.
        is_broken: Whether another evader than the drawn one, tried from `sustained_s` on, broke the claim.
    """

    end: str
    end_s: float
    margin_s: float
    claimed_s: float
    reported_s: float
    sustained_s: float
    was_certain: bool = True
    is_broken: bool = False


def draw_game(seed: int, number: int, shape: str = "point") -> Drawn:
    """Draw a game; in half of them the ideal margin at engagement is within 3 s, in the others within 12 s."""
    aims = SHAPES[shape]
    draw = Random(f"{seed}/{number}" if shape == "point" else f"{shape}/{seed}/{number}")
    aim = aims[number // len(SETUPS) % len(aims)]
    setup = SETUPS[number % len(SETUPS)]._replace(aim=aim)
    game = cycle_settings(setup).game
    extent = game.target_extent
    within_s = draw.choice((3.0, 12.0))
    while True:
        heading = draw.uniform(-math.pi, math.pi)
        away_m = draw.uniform(6.0, 80.0)
        place = (away_m * math.sin(heading), away_m * math.cos(heading))
        margin_s = solve_state(game, setup.start_m, (*place, 0.0), (0.0, 0.0, 0.0)).margin_s
        is_outside = extent.distance_m((0.0, 0.0), place) > 4.0
        if (
            math.dist(place, setup.start_m[:2]) > 12.0
            and abs(margin_s) < within_s
            and (is_outside or extent.is_point)
        ):
            break
    course = _course(draw, place, setup.start_m)
    if shape != "point":
        course = _to_shape(draw, course, aim, extent)
    wind_m_s = draw.uniform(0.0, 4.0)
    blows = draw.uniform(-math.pi, math.pi)
    return Drawn(
        number, setup, place, course, (wind_m_s * math.cos(blows), wind_m_s * math.sin(blows))
    )


def _course(
    draw: Random, place: tuple[float, float], start_m: tuple[float, float, float]
) -> tuple[tuple[float, float], ...]:
    kind = draw.choice(
        (
            "optimal",
            "straight",
            "straight",
            "through places",
            "through places",
            "zigzag",
            "at pursuer",
        )
    )
    (x, y) = place
    away_m = math.hypot(*place)
    if kind == "optimal":
        return ()
    places: list[tuple[float, float]] = []
    if kind == "through places":
        places = [
            (x + draw.gauss(0.0, 12.0), y + draw.gauss(0.0, 12.0))
            for _ in range(draw.randint(1, 3))
        ]
    elif kind == "at pursuer":
        share = draw.uniform(0.2, 0.9)
        places = [(x + share * (start_m[0] - x), y + share * (start_m[1] - y))]
    elif kind == "zigzag":
        steps = draw.randint(2, 6)
        wide = draw.uniform(1.0, 6.0) / away_m
        for step in range(1, steps):
            share = 1.0 - step / steps
            side = wide * (-1) ** step
            places.append((share * x + side * y, share * y - side * x))
    return (*places, (0.0, 0.0))


def _to_shape(
    draw: Random, course: tuple[Point, ...], aim: Aim, extent: Extent
) -> tuple[Point, ...]:
    """Return a course that ends at a drawn point of the target; in a third of the games after a feint at another."""
    if not course:
        return ()
    places = list(course[:-1])
    if draw.random() < 1.0 / 3.0:
        east, north = _edge_point(draw, aim)
        away_m = max(math.hypot(east, north), 1.0)
        stretched = 1.0 + draw.uniform(2.0, 12.0) / away_m
        places.append((stretched * east, stretched * north))
    if draw.random() < 0.5 or not places:
        places.append(_edge_point(draw, aim))
    else:
        # To the nearest point from the last place
        last_east, last_north = places[-1]
        east, north = to_set(FLOATS, extent, (last_east, last_north))
        places.append((last_east + east, last_north + north))
    return tuple(places)


def _edge_point(draw: Random, aim: Aim) -> Point:
    """Draw a point of the target's outline."""
    corners = aim.corners_m or ((0.0, 0.0),)
    number = draw.randrange(len(corners))
    begin = corners[number]
    end = corners[(number + 1) % len(corners)]
    share = draw.random()
    heading = draw.uniform(-math.pi, math.pi)
    east = begin[0] + share * (end[0] - begin[0]) + aim.radius_m * math.sin(heading)
    north = begin[1] + share * (end[1] - begin[1]) + aim.radius_m * math.cos(heading)
    return (east, north)


def _scenario(setup: Setup) -> Scenario:
    scenario = hover_chase(
        setup.autopilot, seed=1, speeds_m_s=setup.speeds_m_s, target_m=(0.0, 0.0)
    )
    pursuer = scenario.pursuer.model_copy(
        update={"position_m": setup.start_m, "policy": setup.policy}
    )
    target = Target(
        position_m=(0.0, 0.0), polygon_m=setup.aim.corners_m, radius_m=setup.aim.radius_m
    )
    return scenario.model_copy(update={"pursuer": pursuer, "target": target})


@cache
def cycle_settings(setup: Setup) -> CycleSettings:
    """Return the settings of the cycles of a game."""
    return _moved(plan_of(scenario=_scenario(setup)).flight, setup.aim).cycle


def _moved(settings: FlightSettings, aim: Aim) -> FlightSettings:
    """Return the settings of a flight whose target moves."""
    game = replace(settings.cycle.game, target_velocity_m_s=aim.velocity_m_s)
    return settings.model_copy(update={"cycle": replace(settings.cycle, game=game)})


class _Game(Chase):
    """A game that is engaged on demand; its evader is given, or it runs through places, or optimally without any."""

    engaging = False
    evader: Evader | None = None
    course_m: Sequence[Point] = ()
    target_m_s: Point = (0.0, 0.0)

    def act(self, _orders: Sequence[Event]) -> Outputs:
        orders = {
            State.READY: (Event.START,),
            State.STANDING_BY: (Event.ENGAGE,) if self.engaging else (),
        }
        outputs: Outputs = self.pilot.run(self.now_s, orders.get(self.state, ()))
        if outputs.certificate is not None and math.isnan(self._engaged_s):
            self._engaged_s = self.now_s
        if self.evader is not None:
            if outputs.certificate is not None:
                meeting_m = outputs.certificate.meeting_point_game_m
                x_m_s, y_m_s = self.evader(self._state(), self.since_s, meeting_m)
                self.runner.run((y_m_s, x_m_s))
            return outputs
        north_m, east_m = self.runner.place_m
        while len(self.course_m) > 1 and math.dist(self.course_m[0], (east_m, north_m)) < 0.2:
            self.course_m = self.course_m[1:]
        if self.course_m:
            self.runner.goal_m = self._goal((east_m, north_m))
        elif outputs.certificate is not None:
            east_m, north_m, _ = outputs.certificate.meeting_point_game_m
            self.runner.goal_m = (north_m, east_m)
        return outputs

    def _state(self) -> GameState:
        (north_m, east_m, down_m), (north_m_s, east_m_s) = self.truth
        evader_north_m, evader_east_m = self.runner.place_m
        evader_north_m_s, evader_east_m_s = self.runner.velocity_m_s
        target_x_m, target_y_m = (part * self.since_s for part in self.target_m_s)
        return GameState(
            Enu((east_m, north_m, -down_m)),
            Enu((east_m_s, north_m_s, 0.0)),
            Enu((evader_east_m, evader_north_m, 0.0)),
            Enu((evader_east_m_s, evader_north_m_s, 0.0)),
            Enu((target_x_m, target_y_m, 0.0)),
        )

    def _goal(self, here_m: Point) -> Point:
        """Return the next place, north and east; the last one is met where it will be."""
        east_m, north_m = self.course_m[0]
        if len(self.course_m) > 1 or self.target_m_s == (0.0, 0.0):
            return (north_m, east_m)
        since_s = 0.0 if math.isnan(self.since_s) else self.since_s
        to_target_m = (
            east_m + self.target_m_s[0] * since_s - here_m[0],
            north_m + self.target_m_s[1] * since_s - here_m[1],
        )
        speed_m_s = self.runner.speed_m_s
        meeting_s = catch_in_ball(FLOATS, speed_m_s, 0.0, to_target_m, self.target_m_s, 0.0)
        return (
            here_m[1] + to_target_m[1] + self.target_m_s[1] * meeting_s,
            here_m[0] + to_target_m[0] + self.target_m_s[0] * meeting_s,
        )


_HOVERING = Flown()


def _hover(setup: Setup) -> _Game:
    game = _Game(_scenario(setup), change=lambda settings: _moved(settings, setup.aim))
    game.target_m_s = setup.aim.velocity_m_s
    game.runner.silent = True
    game.run(120.0, lambda: game.state is State.STANDING_BY)
    return game.run(SETTLED_S)


def fly(drawn: Drawn, evader: Evader | None = None) -> Guarded:
    """Fly a game to its end, against its own evader or another one."""
    game = _HOVERING(drawn.setup, lambda: _hover(drawn.setup), Chase.history)
    game.vehicle.inject("wind_m_s", (*drawn.wind_m_s, 0.0))
    game.runner.begin(drawn.evader_m, seed=drawn.number)
    game.course_m = drawn.course_m
    game.evader = evader
    game.run(HEARD_S)
    game.engaging = True
    end = "undecided"
    margin_s = math.nan
    claimed_s = math.nan
    reported_s = math.nan
    sustained_s = math.nan
    since_s = math.inf
    for outputs in _cycles(game):
        certificate = outputs.certificate
        now_s = game.since_s
        end = _end(outputs) or end
        if certificate is not None:
            margin_s = certificate.margin_s if math.isnan(margin_s) else margin_s
            since_s = min(since_s, now_s) if _claims(certificate) else math.inf
            if math.isnan(claimed_s) and now_s - since_s >= LASTING_S:
                claimed_s = now_s
            if math.isnan(sustained_s) and now_s - since_s >= GUARDED_S:
                sustained_s = now_s
        if outputs.alarm is not None and outputs.alarm.violation is Violation.BARRIER_WON:
            reported_s = now_s
        if end != "undecided":
            break
    return Guarded(end, game.since_s, margin_s, claimed_s, reported_s, sustained_s)


def _cycles(game: _Game) -> Iterator[Outputs]:
    for _ in range(round((LONGEST_S + HEARD_S) / PERIOD_S)):
        game.cycle()
        yield game.outputs.pop()


def _claims(certificate: Certificate) -> bool:
    return certificate.vehicle_winner == Winner.PURSUER


def _end(outputs: Outputs) -> str:
    """Return how the game ended in this cycle; empty if it goes on."""
    names = {Event.CAPTURED: "captured", Event.ESCAPED: "arrived"}
    left = [
        transition
        for transition in outputs.transitions
        if transition.before is State.ENGAGED and transition.after is not State.ENGAGED
    ]
    return names.get(left[0].event, str(left[0].event)) if left else ""
