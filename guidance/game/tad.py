"""The target-attacker-defender game: how close to its target the evader ends (Li, Wang & Xie, section IV).

The evader's region holds the points that it reaches before the pursuer can capture it there. If the target is in the
region, the evader wins. Otherwise it runs to the point of the region closest to the target, and the pursuer meets it
there: g* of eq. (38) in the paper's game (`closest_of_circle`), and the result of `region` in every other. A
Cylinder's region also has the disc ‖X − E‖ ≤ v (t_z + τ), because the evader is safe until the pursuer reaches its
height. This pursuer flies horizontally by the planar region alone, and holds a part that it has reached.

Errors of the paper:

* Evader wins: its "value" ‖P‖² − δ²‖E‖², eq. (36), is the barrier with the sign turned, in m², and no payoff of the
  play that it prescribes. The value here is the payoff of that play, the distance that the pursuer is short of a
  capture when the evader arrives: ‖P − T‖ − δ‖E − T‖ in the paper's game.
* Its payoff J_P there, eq. (35), drops z_P. Flying straight to T would not minimise that: measured horizontally, a
  pursuer would not descend. The distance here is measured in space.
* c = T, where g* has no direction, cannot happen while the pursuer wins (‖c − T‖ > r), but it can when the evader wins.
  The answer is finite there.
"""

from typing import NamedTuple

from guidance.game import pe
from guidance.game.arrays import (
    Library,
    Plane,
    Real,
    Space,
    Truth,
    dot2,
    pair_length,
    plus2,
    times2,
)
from guidance.game.danger import most_in_danger, rivals_of
from guidance.game.extent import from_set, is_inside, nearest, to_set
from guidance.game.game import NO_WIND, Game, Reason
from guidance.game.meeting_times import catch_in_ball
from guidance.game.pe import Geometry, StateSolution
from guidance.game.records import in_rows, is_zero
from guidance.game.region import Closest, closest_point, is_circle, is_missed

REACHED = 30
"""Most rounds to the point of a moving target that the evader can reach first; three are usual."""


class TargetRace(NamedTuple):
    """The race to the target, and the point where the evader ends if the pursuer wins.

    Attributes:
        goal: Vector from the evader to the point where it can meet its target, m.
        arrival: Time until it can be there, s.
        guard: Time until the pursuer could capture an evader there, s.
        margin: arrival − guard, s.
        short: Distance that the pursuer is short of a capture there when the evader arrives, m.
        edge: The closest point of the evader's region to its target, of a Cylinder's the planar part.
    """

    goal: Plane
    arrival: Real
    guard: Real
    margin: Real
    short: Real
    edge: Closest


def defence(xp: Library, game: Game, state: Geometry, target: Plane) -> StateSolution:
    """Solve TAD; see `solve` for the meaning of the answer.

    Args:
        xp: array library.
        game: the game.
        state: the state.
        target: position of the target now, m.
    """
    to_target = (target[0] - state.evader[0], target[1] - state.evader[1])
    danger = _most_in_danger(xp, game, state, to_target)
    target_race = _compare(xp, game, state, to_target, danger)
    margin = target_race.margin
    won = margin > 0
    leading = xp.select2(won, target_race.edge.run, target_race.goal)
    edge = target_race.edge
    run = leading
    if game.pursuer.separate:
        edge = _widened(xp, game, state, to_target, target_race.edge)
        run = xp.select2(won, edge.run, target_race.goal)
    time = xp.select(won, edge.time, target_race.arrival)
    caught = is_caught(xp, game, state)
    distance = edge.distance
    if not game.target_extent.is_point:
        distance = distance - game.target_extent.radius_m
    # The kind of the answer, if the evader is not captured.
    reason = xp.select(margin == 0, int(Reason.ON_BARRIER), int(Reason.SOLVED))
    if not is_zero(game.information_age_s):
        unsure = (margin > 0) & (surely_convex(xp, game, state) == 0)
        ends = (to_target, target_race.goal, target_race.edge.distance)
        dented = is_missed(xp, game, state, ends, unsure)
        if game.pursuer.separate:
            # The disc may cover the dent
            falling_s = _falling_s(xp, game, state)
            ends = (to_target, target_race.goal, edge.distance)
            dented = is_missed(xp, game, state, ends, dented, falling_s=falling_s)
        reason = xp.select(dented, int(Reason.NO_REGION), reason)
    reason = xp.select(target_race.arrival <= 0, int(Reason.ARRIVED), reason)
    return StateSolution(
        winner=xp.sign(margin),
        value=xp.select(won, distance, target_race.short),
        margin_s=margin,
        meeting_point_m=(state.evader[0] + run[0], state.evader[1] + run[1], state.ground),
        meeting_time_s=time,
        pursuer_velocity_m_s=_defending(xp, game, state, target_race, leading, caught),
        evader_velocity_m_s=_attacking(xp, game, target_race, run, time),
        reason=xp.select(caught, int(Reason.CAPTURED), reason),
    )


def _defending(
    xp: Library, game: Game, state: Geometry, target_race: TargetRace, leading: Plane, caught: Truth
) -> Space:
    """Return the pursuer's velocity, m/s.

    Args:
        xp: array library.
        game: the game.
        state: the state.
        target_race: the race.
        leading: the evader's run that the pursuer meets, m.
        caught: whether the evader is captured.
    """
    won = target_race.margin > 0
    meeting_s = target_race.edge.time
    to = (state.to_evader[0] + leading[0], state.to_evader[1] + leading[1])
    hold = xp.select2(won, state.hold, NO_WIND)
    time = xp.select(won, meeting_s, target_race.guard)
    velocity = pe.fly_to(xp, game, state._replace(hold=hold), to, time)
    if is_zero(game.information_age_s):
        return velocity
    # With old information, a pursuer at the meeting point may find that the evader has not run there. One that stayed
    # would let it pass, so it plays PE.
    stale = won & (meeting_s <= 0) & (caught == 0)
    if not xp.any(stale):
        return velocity
    pursuing = pe.pursuit(xp, game, state).pursuer_velocity_m_s
    chosen: Space = xp.select_all(stale, pursuing, velocity)
    return chosen


def _attacking(xp: Library, game: Game, target_race: TargetRace, run: Plane, time: Real) -> Space:
    """Return the evader's velocity, m/s, which runs straight for some time; it stays at its target."""
    v = game.evader_speed_m_s
    age = game.information_age_s
    length = v * _later(time, age)
    to_goal = v * _later(target_race.arrival, age)
    moves = length > 0
    way = xp.select2(moves, run, target_race.goal)
    heading = xp.unit2(way, xp.select(moves, length, to_goal))
    pace = xp.select(target_race.arrival <= 0, 0.0, v)
    return pace * heading[0], pace * heading[1], 0.0


def _most_in_danger(xp: Library, game: Game, state: Geometry, to_target: Plane) -> Plane:
    """Return the vector from E to the point of the target's set where the pursuer's margin is least."""
    extent = game.target_extent
    if extent.is_point:
        return from_set(to_target, extent.corners_m[0])
    rivals = rivals_of(xp, game, state, to_target)
    point = from_set(to_target, most_in_danger(xp, extent, rivals))
    if game.pursuer.separate or not is_zero(game.capture_radius_m):
        # Until the pursuer is at its height, or where it can capture now, only the evader's time counts.
        offset = to_set(xp, extent, rivals.evader)
        # The vector from E to the point of the target's set that it can reach first.
        adrift = game.target_velocity_m_s
        first = offset
        if adrift != NO_WIND:
            for _ in range(REACHED):
                # The nearest point when this one is reached can be reached no later.
                arrival, _ = _arrive(xp, game, first)
                moved = plus2(to_target, arrival, adrift)
                nearest_then = to_set(xp, game.target_extent, (-moved[0], -moved[1]))
                near = plus2(nearest_then, -arrival, adrift)
                sooner = _arrive(xp, game, near)[0] < arrival
                first = xp.select2(sooner, near, first)
                if not xp.any(sooner):
                    break
        sooner = _margin(xp, game, state, first) < _margin(xp, game, state, point)
        point = xp.select2(sooner, first, point)
    inside = is_inside(xp, extent, rivals.evader)
    return xp.select2(inside, times2(0.0, to_target), point)


def _margin(xp: Library, game: Game, state: Geometry, to_point: Plane) -> Real:
    """Return the pursuer's margin at a point of the target, given from the evader, s."""
    arrival, goal = _arrive(xp, game, to_point)
    return arrival - guard_time(xp, game, state, goal)


def _compare(
    xp: Library, game: Game, state: Geometry, centre: Plane, to_target: Plane
) -> TargetRace:
    """Compare the times to the target, with the paper's formulas if the game is the paper's.

    Args:
        xp: array library.
        game: the game.
        state: the state.
        centre: vector from the evader to the target's position, m.
        to_target: to the point of the target that is most in danger, m.
    """
    circle = is_circle(game)
    flat = game.pursuer.separate
    paper = None if circle is False else _paper(xp, game, state, centre, to_target)
    if paper is not None and circle is True and not flat:
        return paper
    arrival, goal = _arrive(xp, game, to_target)
    guard = guard_time(xp, game, state, goal)
    margin = arrival - guard
    lost = margin < 0
    y = (state.to_evader[0] + goal[0], state.to_evader[1] + goal[1])
    if not game.calm:
        y = (y[0] - game.wind_m_s[0] * arrival, y[1] - game.wind_m_s[1] * arrival)
    beside = xp.norm2(y) - game.standoff.radius_m
    left = game.pursuer.shortfall(xp, game.capture_radius_m, beside, state.z, arrival)
    level = xp.select(lost, xp.maximum(left.level, 0.0), 1.0)
    short = xp.select(lost, xp.norm2((level, left.vertical)) - left.reach, 0.0)
    if paper is not None and circle is True:
        return TargetRace(goal, arrival, guard, margin, short, paper.edge)
    selected = margin > 0 if paper is None else (margin > 0) & ~circle
    near = goal
    # The vector to the point of its target that is nearest now, when the evader can meet it
    if not game.target_extent.is_point:
        of_set, _ = nearest(xp, game.target_extent, (-centre[0], -centre[1]))
        _, near = _arrive(xp, game, from_set(centre, of_set))
    edge = closest_point(xp, game, state, centre, near, selected)
    target_race = TargetRace(goal, arrival, guard, margin, short, edge)
    if paper is None:
        return target_race
    merged = xp.select_all(circle, paper, target_race)
    return target_race._replace(edge=merged.edge) if flat else merged


def _paper(xp: Library, game: Game, state: Geometry, centre: Plane, to_target: Plane) -> TargetRace:
    z = game.pursuer.planar(xp, game.standoff.radius_m, game.capture_radius_m, state.z).z
    u = game.pursuer.horizontal_m_s
    v = game.evader_speed_m_s
    speeds = (u, v)
    squares = _squares(state.to_evader, z, to_target)
    barrier = _barrier(speeds, squares)
    target_race = race(xp, speeds, to_target, squares, barrier)
    if game.target_extent.is_point:
        edge = closest_of_circle(xp, speeds, (state.to_evader, z, to_target), barrier)
        return target_race._replace(edge=edge)

    def closest(speeds: tuple[Real, Real], to_evader: Plane, z: Real, centre: Plane) -> Closest:
        """Return the circle's point closest to the target: to that of its points closest to the circle's centre c."""
        u, v = speeds
        lead = v * v / ((u - v) * (u + v))
        centre_c = (lead * to_evader[0] - centre[0], lead * to_evader[1] - centre[1])
        near, _ = nearest(xp, game.target_extent, centre_c)
        to_near = from_set(centre, near)
        barrier = _barrier(speeds, _squares(to_evader, z, to_near))
        return closest_of_circle(xp, speeds, (to_evader, z, to_near), barrier)

    won = target_race.margin > 0.0
    edge = in_rows(won, target_race.edge, closest, speeds, state.to_evader, z, centre)
    return target_race._replace(edge=edge)


def race(
    xp: Library,
    speeds: tuple[Real, Real],
    to_target: Plane,
    squares: tuple[Real, Real],
    barrier: Real,
) -> TargetRace:
    """Return the race to a target in the paper's game, without the edge; its margin is the barrier B as a time.

    Args:
        xp: array library.
        speeds: u and v, m/s.
        to_target: horizontal vector from E to T, m.
        squares: of the distances of E and of P from T, m².
        barrier: B times v².
    """
    u, v = speeds
    near, far = squares
    distance = xp.sqrt(near)
    total = u * distance + v * xp.sqrt(far)
    arrival = distance / v
    margin = barrier / (u * v * xp.select(total > 0, total, 1.0))
    nothing = Closest(to_target, 0.0, 0.0)
    return TargetRace(to_target, arrival, arrival - margin, margin, -u * margin, nothing)


def closest_of_circle(
    xp: Library,
    speeds: tuple[Real, Real],
    state: tuple[Plane, Real, Plane],
    barrier: Real,
) -> Closest:
    """Return the point of the paper's circle that is closest to a target, g*.

    L = ‖c − T‖ − r = d_δ/(δ² − 1) − r, eq. (41), is the difference of two lengths that grow without bound as δ → 1.
    Times their sum it is the barrier B over δ² − 1, which cancels nothing and is zero exactly where B is:

        L = B / (d_δ + √((δ² − 1) z² + δ² d²))

    g* lies between c and T, L from T and r from c, so it is (L c + r T)/‖c − T‖.

    Args:
        xp: array library.
        speeds: u and v, m/s.
        state: horizontal vector from P to E, height of P above E's plane, horizontal vector from E to T, m.
        barrier: B times v².
    """
    u, v = speeds
    to_evader, z, to_target = state
    hand = (u - v) * (u + v)
    delta = (
        v * v * to_evader[0] - hand * to_target[0],
        v * v * to_evader[1] - hand * to_target[1],
    )
    d_delta = xp.norm2(delta)
    span = v * xp.sqrt(hand * (z * z) + (u * u) * dot2(to_evader, to_evader))
    lengths = d_delta + span
    # Zero is divided by the same length, because its derivative is not zero
    final = barrier / xp.select(lengths > 0, lengths, 1.0)
    inverse = 1.0 / xp.select(d_delta > 0, d_delta, 1.0)
    lead = (v * v) * (final * inverse)
    share = span * inverse
    run = (lead * to_evader[0] + share * to_target[0], lead * to_evader[1] + share * to_target[1])
    return Closest(run, xp.norm2(run) / v, final)


def _squares(to_evader: Plane, z: Real, to_target: Plane) -> tuple[Real, Real]:
    """Return the squares of the distances of E and of P from a target, m²."""
    to_pursued = (to_evader[0] + to_target[0], to_evader[1] + to_target[1])
    return dot2(to_target, to_target), dot2(to_pursued, to_pursued) + z * z


def _barrier(speeds: tuple[Real, Real], squares: tuple[Real, Real]) -> Real:
    """Return the barrier B times v²."""
    u, v = speeds
    near, far = squares
    return (u * u) * near - (v * v) * far


def _arrive(xp: Library, game: Game, to_target: Plane) -> tuple[Real, Plane]:
    """Return the time until the evader can be at its target, and the target's position then, from the evader."""
    v = game.evader_speed_m_s
    age = game.information_age_s
    adrift = game.target_velocity_m_s
    if adrift == NO_WIND:
        return xp.maximum(xp.norm2(to_target) / v - age, 0.0), to_target
    arrival = catch_in_ball(xp, v, v * age, to_target, adrift, 0.0)
    return arrival, (to_target[0] + adrift[0] * arrival, to_target[1] + adrift[1] * arrival)


def guard_time(xp: Library, game: Game, state: Geometry, goal: Plane) -> Real:
    """Return the time, s, until the pursuer could capture an evader at `goal`.

    Args:
        xp: array library.
        game: speed set, capture radius, stand-off disc, wind.
        state: the state.
        goal: vector from the evader to that point, m.
    """
    pursuer = game.pursuer
    radius = game.standoff.radius_m
    capture = game.capture_radius_m
    y = (state.to_evader[0] + goal[0], state.to_evader[1] + goal[1])
    if game.calm:
        gap = xp.norm2(y) - radius
        return pursuer.cover_time(xp, radius, capture, gap, pursuer.horizontal_m_s, state.z)
    drift = (-game.wind_m_s[0], -game.wind_m_s[1])
    return pursuer.catch_time(xp, radius, capture, y, drift, state.z)


def surely_convex(xp: Library, game: Game, state: Geometry) -> Truth:
    """Return whether the evader's region is convex by simple bounds.

    Points X of the region's edge are reached at the same time, |XE|/v − τ = t(X). With g the pursuer's distance from
    the stand-off disc, and c = u τ − l:

    * No part of the evader's spread v τ may be captured now. Else the evader may also end there, not only at the edge.
    * If c ≤ 0, the region is an intersection of discs.
    * In the plane in still air (Cylinder with R in l, and an evader in space) the edge is a Cartesian oval. It has a
      dent in front of the pursuer unless c ≤ (u/v − 1)|PE|.
    * Else the bend of the evader's time has to exceed the largest possible bend of the pursuer's everywhere.

    Args:
        xp: array library.
        game: speeds, capture radius, stand-off, age and wind.
        state: the state.
    """
    u = game.pursuer.horizontal_m_s
    v = game.evader_speed_m_s
    age = game.information_age_s
    radius, capture, z = game.pursuer.planar(
        xp, game.standoff.radius_m, game.capture_radius_m, state.z
    )
    level = game.pursuer.separate or game.evader_space == "space"
    beside = xp.norm2(state.to_evader)
    spread = v * age
    apart = xp.maximum(beside - spread - radius, 0.0 * beside)
    free = xp.sqrt(apart * apart + z * z) >= capture
    lead = u * age - capture
    if level and game.calm:
        return free & (lead * v <= (u - v) * beside)
    blown = u - pair_length(game.wind_m_s)
    way = xp.maximum(xp.sqrt(apart * apart + z * z) - capture, 0.0 * apart)
    run = v * (age + way / (2.0 * u))
    share = blown * blown * blown * (1.0 - (v / blown) * (v / blown))
    bends = run * (share * (u / v) - u * u * v) >= share * lead
    return free & ((lead <= 0.0) | bends)


def _later(time: Real, age: Real) -> Real:
    """Return time + age; most games have no age, and the sum is left out."""
    return time if is_zero(age) else time + age


def is_caught(xp: Library, game: Game, state: Geometry) -> Truth:
    """Return whether the evader is captured now, anywhere within v τ of its last position."""

    def beside() -> Real:
        return xp.norm2(state.to_evader) + (
            game.evader_speed_m_s * game.information_age_s - game.standoff.radius_m
        )

    return game.pursuer.captured(xp, game.capture_radius_m, state.z, beside)


def _widened(xp: Library, game: Game, state: Geometry, to_target: Plane, level: Closest) -> Closest:
    """Add to the planar region the disc that the evader reaches before the pursuer reaches its height."""
    falling = _falling_s(xp, game, state)
    adrift = game.target_velocity_m_s
    radius = game.evader_speed_m_s * (falling + game.information_age_s)
    drifted = (to_target[0] + adrift[0] * falling, to_target[1] + adrift[1] * falling)
    near, _ = nearest(xp, game.target_extent, (-drifted[0], -drifted[1]))
    goal = from_set(drifted, near)
    far = xp.norm2(goal)
    towards = xp.unit2(goal, far)
    run = (radius * towards[0], radius * towards[1])
    left = far - radius
    fallen = Closest(run, falling, abs(left))
    return xp.select_all(left < level.distance, fallen, level)


def _falling_s(xp: Library, game: Game, state: Geometry) -> Real:
    """Return the time until a Cylinder is at the evader's height, s."""
    return xp.maximum(game.pursuer.level_time(xp, game.capture_radius_m, state.z), 0.0)
