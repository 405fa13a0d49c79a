"""Rules for the play of teams of pursuers: whom each pursuer chases, and how. They know no guarantees.

`rollout_teams` plays a rule by its name, so that it can be compared with the play that keeps promises.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from guidance.game.arrays import Array
from guidance.game.game import Game
from guidance.game.policies import PURSUER_POLICIES, Policy
from guidance.game.rows import for_rows
from guidance.game.team.capture_sequences import lead_and_place
from guidance.game.team.packing import assigned
from guidance.game.team.table import place_of, taken


class TeamView(NamedTuple):
    """Inputs of a team's rule at a moment of a batch of games, for leading axes (...).

    Attributes:
        game: of every pair; its numbers are single or (..., n, m).
        pursuers_m: positions, (..., n, 3), m.
        evaders_m: positions, (..., m, 3), m.
        target_m: position of each evader's target, (..., m, 3), m; None in PE.
        evader_velocity_m_s: velocities of the step before, (..., m, 3), m/s; zero before the first.
        pursuer_velocity_m_s: the same of the pursuers, (..., n, 3).
        in_play: which evaders are neither captured nor arrived, (..., m).
    """

    game: Game
    pursuers_m: Array
    evaders_m: Array
    target_m: Array | None
    evader_velocity_m_s: Array
    pursuer_velocity_m_s: Array
    in_play: Array


class TeamRule(NamedTuple):
    """A rule: its name, and a function of a view that returns the velocities of the pursuers, (..., n, 3), m/s."""

    name: str
    play: Callable[[TeamView], Array]


def chase(view: TeamView, evader_of: Array, policy: Policy) -> Array:
    """Return the velocities, (..., n, 3), m/s, of pursuers that play a policy, each against one evader.

    Args:
        view: the moment.
        evader_of: number of each pursuer's evader, (..., n); −1 is played as 0.
        policy: of the pursuers.
    """
    at = place_of(evader_of, evader_of.ndim - 1)
    games = for_rows(view.game, lambda value: taken(value, evader_of))
    target_m = None if view.target_m is None else view.target_m[at]
    seen_m_s = view.evader_velocity_m_s[at]
    return policy(games, view.pursuers_m, view.evaders_m[at], target_m, seen_m_s)


def nearest_evader(view: TeamView) -> Array:
    """Return the number of the evader in play that is nearest to each pursuer, (..., n)."""
    offset_m = view.pursuers_m[..., :, None, :] - view.evaders_m[..., None, :, :]
    square = np.sum(offset_m**2, axis=-1)
    return np.argmin(np.where(view.in_play[..., None, :], square, np.inf), axis=-1)


def _nearest(view: TeamView) -> Array:
    """Fly at the nearest evader."""
    return chase(view, nearest_evader(view), PURSUER_POLICIES["pure_pursuit"])


def _lead(view: TeamView) -> Array:
    """Fly to the point of capture of the nearest evader, if it keeps its velocity."""
    return chase(view, nearest_evader(view), PURSUER_POLICIES["lead_pursuit"])


def _hungarian(view: TeamView) -> Array:
    """Assign evaders to pursuers, one each, for the least sum of times of capture; others lead the nearest one."""
    P = view.pursuers_m[..., :, None, :]
    E = view.evaders_m[..., None, :, :]
    time_s, _ = lead_and_place(view.game, P, E, view.evader_velocity_m_s[..., None, :, :])
    *leading, n, m = time_s.shape
    times_s = np.where(view.in_play[..., None, :], time_s, np.inf).reshape(-1, n, m)
    latest_s = np.max(np.where(np.isfinite(times_s), times_s, 0.0), axis=(1, 2), keepdims=True)
    pursuer_of = assigned((latest_s - times_s).swapaxes(1, 2))
    takes = pursuer_of[:, None, :] == np.arange(n)[:, None]
    evader_of = np.argmax(takes, axis=-1).reshape(*leading, n)
    is_assigned = takes.any(axis=-1).reshape(*leading, n)
    evader_of = np.where(is_assigned, evader_of, nearest_evader(view))
    return chase(view, evader_of, PURSUER_POLICIES["lead_pursuit"])


TEAM_RULES: Mapping[str, TeamRule] = MappingProxyType(
    {
        "nearest": TeamRule("nearest", _nearest),
        "hungarian": TeamRule("hungarian", _hungarian),
        "lead": TeamRule("lead", _lead),
    }
)
"""Every rule of a team, by its name."""
