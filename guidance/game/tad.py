"""The target-attacker-defender game: how close to its target the evader ends (Li, Wang & Xie, section IV).

The evader owns the points that it reaches before the pursuer can have it captured there. With the target among them it
wins. Otherwise it goes for the point of that region closest to the target, and the pursuer meets it there (`edge`).

Where the paper is wrong:

* Evader wins: its "value" ‖P‖² − δ²‖E‖² is the barrier with the sign turned, in m², and no payoff of the play that it
  prescribes. The value here is what that play ends with, the distance that the pursuer is short of a capture when the
  evader arrives: ‖P − T‖ − δ‖E − T‖ in the paper's game.
* Its payoff J_P there drops z_P. Flying straight to T would not minimise that: measured horizontally, a pursuer would
  spend nothing on its descent. The distance here is measured in space.
* c = T, where g* has no direction, cannot happen while the pursuer wins (‖c − T‖ > r), but it can when the evader wins.
  The answer is finite there.
"""

from guidance.game.arrays import Array, Library, Plane, norm2, positive_part, select, select2, unit2
from guidance.game.edge import edge_point
from guidance.game.game import STILL, Ball, Game, is_calm
from guidance.game.play import Play, State
from guidance.game.reach import catch_in_ball, catch_time, cover_time, steer, vertical_speed
from guidance.game.reasons import Reason, Winner


def defence(xp: Library, game: Game, state: State, target: Plane) -> Play:
    """Play the TAD game from a state taken apart; see `solve` for what the answer means."""
    v, age = game.evader_speed_m_s, game.information_age_s
    to_target = (target[0] - state.evader[0], target[1] - state.evader[1])
    arrival, goal = _arrive(xp, game, to_target)
    guard = guard_time(xp, game, state, goal)
    margin = arrival - guard
    lost, arrived = margin < 0, arrival <= 0
    edge = edge_point(xp, game, state, to_target, goal)
    run = select2(xp, lost, goal, edge.run)
    lead = select2(xp, lost, goal, edge.lead)
    to = (state.to_evader[0] + lead[0], state.to_evader[1] + lead[1])
    gap = norm2(xp, to) - game.standoff.radius_m - game.capture_radius_m
    caught = cover_time(xp, game, state.distance + v * age - game.standoff.radius_m, 0.0, state.z) <= 0
    hold = (0.0, 0.0) if state.seen is None else select2(xp, caught, state.seen, (0.0, 0.0))
    length = norm2(xp, run)
    heading = select2(xp, length > 0, unit2(xp, run, length), unit2(xp, goal, norm2(xp, goal)))
    pace = select(xp, arrived, 0.0, v)
    return Play(
        winner=_winner(xp, margin),
        value=select(xp, lost, _shortfall(xp, game, state, goal, arrival, lost), edge.left),
        margin=margin,
        meeting=(state.evader[0] + run[0], state.evader[1] + run[1], state.ground),
        time=select(xp, lost, arrival, edge.time),
        pursuer=steer(xp, game, to, gap, select(xp, lost, guard, edge.lead_time), state.z, hold),
        evader=(pace * heading[0], pace * heading[1], 0.0),
        reason=_reason(xp, margin, arrived, caught),
    )


def _arrive(xp: Library, game: Game, to_target: Plane) -> tuple[Array, Plane]:
    """Return when the evader can be at its target, and where that is then, from the evader."""
    v, age, adrift = game.evader_speed_m_s, game.information_age_s, game.target_velocity_m_s
    if adrift == STILL:
        return positive_part(norm2(xp, to_target) / v - age), to_target
    arrival = catch_in_ball(xp, v, v * age, to_target, adrift, 0.0)
    return arrival, (to_target[0] + adrift[0] * arrival, to_target[1] + adrift[1] * arrival)


def guard_time(xp: Library, game: Game, state: State, goal: Plane) -> Array:
    """Return how soon, s, the pursuer could hold captured whoever is at `goal`, a vector from the evader."""
    y = (state.to_evader[0] + goal[0], state.to_evader[1] + goal[1])
    if is_calm(game):
        return cover_time(xp, game, norm2(xp, y) - game.standoff.radius_m, 0.0, state.z)
    return catch_time(xp, game, y, (-game.wind_m_s[0], -game.wind_m_s[1]), state.z)


def _winner(xp: Library, margin: Array) -> Array:
    ahead = select(xp, margin > 0, int(Winner.PURSUER), int(Winner.UNDECIDED))
    return select(xp, margin < 0, int(Winner.EVADER), ahead)


def _reason(xp: Library, margin: Array, arrived: Array, caught: Array) -> Array:
    reason = select(xp, margin == 0, int(Reason.ON_BARRIER), int(Reason.SOLVED))
    reason = select(xp, arrived, int(Reason.ARRIVED), reason)
    return select(xp, caught, int(Reason.CAPTURED), reason)


def _shortfall(xp: Library, game: Game, state: State, goal: Plane, arrival: Array, lost: Array) -> Array:
    """Return the distance, m, that the pursuer is short of a capture at `goal` when the evader arrives there.

    Where the evader does not win, one metre stands in: the derivative of a square root at zero would spoil the gradient
    of the rows that matter, in the libraries that differentiate.
    """
    wind = game.wind_m_s
    y = (
        state.to_evader[0] + goal[0] - wind[0] * arrival,
        state.to_evader[1] + goal[1] - wind[1] * arrival,
    )
    beside = norm2(xp, y) - game.standoff.radius_m
    if isinstance(game.pursuer, Ball):
        flown, above = game.pursuer.speed_m_s * arrival + game.capture_radius_m, state.z
    else:
        beside = beside - game.capture_radius_m - game.pursuer.horizontal_m_s * arrival
        above = abs(state.z) - game.capture_radius_m - vertical_speed(xp, game.pursuer, state.z) * arrival
        flown, above = 0.0, positive_part(above)
    return norm2(xp, (select(xp, lost, positive_part(beside), 1.0), above)) - flown
