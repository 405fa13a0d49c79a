"""A user's policy of the pursuers of a team, as a rule of the team.

It is the function that is trained as an agent of `guidance.league.PursuitParallelEnv`: of observations (rows, k), one
row for each pursuer of each game, to actions (rows, 3), shares of the speed from −1 to 1. An observation has, in m and
m/s of the game frame: the pursuer's own height (1 column); of every evader, in their order, place and velocity relative
to its own (6 each); of its mates the same; and in TAD the target's place, relative (2). Of an evader that is out of the
game all are 0.
"""

import numpy as np

from guidance.errors import ConfigError
from guidance.game.arrays import Array
from guidance.game.speed_sets import bounded
from guidance.game.team import TeamRule, TeamView
from guidance.strategies.own import PURSUER_SHARES, PolicyError, action_of, load_policy, shares_of


def observed_by(
    number: int,
    pursuers: int,
    places_m: Array,
    velocities_m_s: Array,
    present: Array,
    target_m: Array | None,
) -> Array:
    """Return the observations of a player of a team, (..., k).

    Args:
        number: of the player; evaders are counted after the pursuers.
        pursuers: their number.
        places_m: of all players, (..., n + m, 3).
        velocities_m_s: the same.
        present: which players are in the game, (..., n + m).
        target_m: (..., 3); None in PE.
    """
    own_m = places_m[..., number, :]
    offset_m = places_m - own_m[..., None, :]
    relative_m_s = velocities_m_s - velocities_m_s[..., number, None, :]
    relative = np.concatenate([offset_m, relative_m_s], axis=-1)
    relative = np.where(present[..., None], relative, 0.0)
    everybody = range(places_m.shape[-2])
    mates = [other for other in everybody if (other < pursuers) == (number < pursuers)]
    opponents = [other for other in everybody if other not in mates]
    others = [other for other in (*opponents, *mates) if other != number]
    columns = relative[..., others, :].reshape(*own_m.shape[:-1], -1)
    parts = [own_m[..., 2:], columns]
    if target_m is not None:
        parts.append(target_m[..., :2] - own_m[..., :2])
    return np.concatenate(parts, axis=-1)


def own_rule(name: str) -> TeamRule:
    """Return the rule of a team whose pursuers all ask a user's policy.

    Raises:
        ConfigError: If it is unknown; when it is played, if it raises or answers no finite actions.
    """
    choose = load_policy(name)

    def play(view: TeamView) -> Array:
        P = view.pursuers_m
        places_m = np.concatenate([P, view.evaders_m], axis=-2)
        velocities_m_s = np.concatenate(
            [view.pursuer_velocity_m_s, view.evader_velocity_m_s], axis=-2
        )
        there = np.ones(P.shape[:-1], dtype=bool)
        present = np.concatenate([there, view.in_play], axis=-1)
        target_m = None if view.target_m is None else view.target_m[..., 0, :]
        n = P.shape[-2]
        rows = [
            observed_by(number, n, places_m, velocities_m_s, present, target_m)
            for number in range(n)
        ]
        observations = np.stack(rows, axis=-2)
        try:
            flat = observations.reshape(-1, observations.shape[-1])
            action = action_of(name, choose, flat, PURSUER_SHARES)
        except PolicyError as error:
            raise ConfigError(f"policy = {name!r}: {error}") from error
        if not np.isfinite(action).all():
            raise ConfigError(f"policy = {name!r}: it answers numbers that are not finite")
        speed_m_s = np.asarray(view.game.pursuer.horizontal_m_s)
        if speed_m_s.ndim:
            speed_m_s = speed_m_s[..., 0, None]
        return np.asarray(speed_m_s * bounded(shares_of(action), 1.0).reshape(P.shape))

    return TeamRule(name, play)
