"""The target-attacker-defender game: where, and how far from its target, the evader ends (Li, Wang & Xie, section IV).

The evader owns the points that it reaches before the pursuer can have it captured there. With the target among them it wins;
otherwise it goes for the point of that region's edge closest to the target, and the pursuer meets it there. Without capture
radius, stand-off disc, age and wind the region is the Apollonius disc and the point is the paper's g*; a Cylinder's region is
the planar one together with the disc ‖X − E‖ ≤ v (t_z + τ) that the evader has while the pursuer's height is not yet spent.
Every other region is searched over headings: `reach.catch_time` gives its edge in closed form, or nearly so.

Where the paper is wrong:

* Evader wins: its "value" ‖P‖² − δ²‖E‖² is the barrier with the sign turned, in m², and no payoff of the play that it
  prescribes. The value here is what that play ends with, the distance that the pursuer is short of a capture when the
  evader arrives: ‖P − T‖ − δ‖E − T‖ in the paper's game.
* Its payoff J_P there drops z_P. Flying straight to T would not minimise that: measured horizontally, a pursuer would spend
  nothing on its descent. The distance here is measured in space.
* c = T, where g* has no direction, cannot happen while the pursuer wins (‖c − T‖ > r), but it can when the evader wins. The
  answer is finite there.
"""

from typing import Any

from guidance.game.arrays import Array, Plane, norm2, positive_part, select, unit2
from guidance.game.game import Ball, Cylinder, Game, horizontal_speed
from guidance.game.play import Play, State
from guidance.game.reach import (
    catch_in_ball,
    catch_time,
    cover_time,
    dot2,
    is_calm,
    is_zero,
    steer,
    vertical_speed,
)
from guidance.game.reasons import Reason, Winner
from guidance.game.search import closest_heading


def defence(xp: Any, game: Game, state: State, target: Plane) -> Play:  # noqa: ANN401
    """Play the TAD game from a state taken apart; see `solve` for what the answer means."""
    v, age, adrift = game.evader_speed_m_s, game.information_age_s, game.target_velocity_m_s
    to_target = (target[0] - state.evader[0], target[1] - state.evader[1])
    arrival = catch_in_ball(xp, v, v * age, to_target, adrift, 0.0)
    goal = (to_target[0] + adrift[0] * arrival, to_target[1] + adrift[1] * arrival)
    guard = guard_time(xp, game, state, goal)
    margin = arrival - guard
    run, met, lead, lead_time = _meet(xp, game, state, to_target, goal)
    lost = margin < 0
    run = (select(xp, lost, goal[0], run[0]), select(xp, lost, goal[1], run[1]))
    lead = (select(xp, lost, goal[0], lead[0]), select(xp, lost, goal[1], lead[1]))
    met = select(xp, lost, arrival, met)
    left = (to_target[0] + adrift[0] * met - run[0], to_target[1] + adrift[1] * met - run[1])
    to = (state.to_evader[0] + lead[0], state.to_evader[1] + lead[1])
    caught = cover_time(xp, game, state.distance + v * age - game.standoff.radius_m, 0.0, state.z) <= 0
    hold = (select(xp, caught, state.drift[0], 0.0), select(xp, caught, state.drift[1], 0.0))
    gap = norm2(xp, to) - game.standoff.radius_m - game.capture_radius_m
    arrived = arrival <= 0
    heading = _heading(xp, run, goal)
    pace = select(xp, arrived, 0.0, v)
    reason = select(xp, margin == 0, int(Reason.ON_BARRIER), int(Reason.SOLVED))
    reason = select(xp, arrived, int(Reason.ARRIVED), reason)
    return Play(
        winner=select(xp, margin > 0, int(Winner.PURSUER), select(xp, lost, int(Winner.EVADER), int(Winner.UNDECIDED))),
        value=select(xp, lost, _shortfall(xp, game, state, goal, arrival), norm2(xp, left)),
        margin=margin,
        meeting=(state.evader[0] + run[0], state.evader[1] + run[1], state.ground),
        time=met,
        pursuer=steer(xp, game, to, gap, select(xp, lost, guard, lead_time), state.z, hold),
        evader=(pace * heading[0], pace * heading[1], 0.0),
        reason=select(xp, caught, int(Reason.CAPTURED), reason),
    )


def _heading(xp: Any, run: Plane, goal: Plane) -> Plane:  # noqa: ANN401
    """Direction of the evader's run; towards its target where there is nothing to run."""
    length = norm2(xp, run)
    still = length <= 0
    there, ahead = unit2(xp, goal, norm2(xp, goal)), unit2(xp, run, length)
    return select(xp, still, there[0], ahead[0]), select(xp, still, there[1], ahead[1])


def guard_time(xp: Any, game: Game, state: State, goal: Plane) -> Array:  # noqa: ANN401
    """Return how soon the pursuer can hold an evader captured at `goal`, given from the evader."""
    y = (state.to_evader[0] + goal[0], state.to_evader[1] + goal[1])
    if is_calm(game):
        return cover_time(xp, game, norm2(xp, y) - game.standoff.radius_m, 0.0, state.z)
    return catch_time(xp, game, y, (-game.wind_m_s[0], -game.wind_m_s[1]), state.z)


def _shortfall(xp: Any, game: Game, state: State, goal: Plane, arrival: Array) -> Array:  # noqa: ANN401
    """Return the distance, m, that the pursuer is short of a capture at `goal` when the evader arrives there."""
    y = (
        state.to_evader[0] + goal[0] - game.wind_m_s[0] * arrival,
        state.to_evader[1] + goal[1] - game.wind_m_s[1] * arrival,
    )
    beside = norm2(xp, y) - game.standoff.radius_m
    if isinstance(game.pursuer, Ball):
        return norm2(xp, (positive_part(beside), state.z)) - game.pursuer.speed_m_s * arrival - game.capture_radius_m
    beside = beside - game.capture_radius_m - game.pursuer.horizontal_m_s * arrival
    above = abs(state.z) - game.capture_radius_m - vertical_speed(xp, game.pursuer, state.z) * arrival
    return norm2(xp, (positive_part(beside), positive_part(above)))


def _meet(
    xp: Any,  # noqa: ANN401
    game: Game,
    state: State,
    to_target: Plane,
    goal: Plane,
) -> tuple[Plane, Array, Plane, Array]:
    """Find the evader's run and its time, and the run and time by which the pursuer steers horizontally."""
    near, near_time = _edge_point(xp, game, state, to_target, goal)
    pursuer = game.pursuer
    if isinstance(pursuer, Ball):
        return near, near_time, near, near_time
    v, adrift = game.evader_speed_m_s, game.target_velocity_m_s
    falling = positive_part((abs(state.z) - game.capture_radius_m) / vertical_speed(xp, pursuer, state.z))
    goal = (to_target[0] + adrift[0] * falling, to_target[1] + adrift[1] * falling)
    far = norm2(xp, goal)
    radius = v * (falling + game.information_age_s)
    towards = unit2(xp, goal, far)
    left = norm2(xp, (to_target[0] + adrift[0] * near_time - near[0], to_target[1] + adrift[1] * near_time - near[1]))
    above = far - radius < left
    run = (select(xp, above, radius * towards[0], near[0]), select(xp, above, radius * towards[1], near[1]))
    return run, select(xp, above, falling, near_time), near, near_time


def _edge_point(xp: Any, game: Game, state: State, to_target: Plane, goal: Plane) -> tuple[Plane, Array]:  # noqa: ANN401
    """Find the point of the edge of the evader's region closest to the target, from the evader, and the time to it."""
    v = game.evader_speed_m_s
    flat = isinstance(game.pursuer, Cylinder)
    if is_circle(game):
        delta = horizontal_speed(game.pursuer) / v
        run = circle_point(xp, delta, state.to_evader, 0.0 if flat else state.z, to_target)
        return run, norm2(xp, run) / v
    return closest_heading(xp, game, state, to_target, goal)


def is_circle(game: Game) -> bool:
    """Say whether the (planar part of the) region is the Apollonius circle of the paper."""
    plain = (game.capture_radius_m, game.standoff.radius_m, game.information_age_s, *game.target_velocity_m_s)
    return is_calm(game) and all(is_zero(value) for value in plain)


def circle_point(xp: Any, delta: Array, to_evader: Plane, z: Array, to_target: Plane) -> Plane:  # noqa: ANN401
    """Return g* − E: the point of the Apollonius circle closest to the target (section IV-B)."""
    hand = delta * delta - 1.0
    centre = (to_evader[0] / hand, to_evader[1] / hand)
    radius = xp.sqrt(z * z * hand + delta * delta * dot2(to_evader, to_evader)) / hand
    out = (to_target[0] - centre[0], to_target[1] - centre[1])
    direction = unit2(xp, out, norm2(xp, out))
    return centre[0] + radius * direction[0], centre[1] + radius * direction[1]
