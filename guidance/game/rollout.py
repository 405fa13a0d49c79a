"""Two policies closed over point masses, for one game or a batch, to the end of the game."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from guidance.errors import ConfigError
from guidance.game.arrays import Array, choose, norm3, spread, vectors
from guidance.game.game import Game
from guidance.game.policies import EVADER_POLICIES, PURSUER_POLICIES, Policy
from guidance.game.records import is_zero, require
from guidance.game.solution import leading_shape, quiet, solve
from guidance.game.stepping import End, Exact, Paper, Sample, Velocities, exact_samples, published_samples

EXACT = Exact()


class Rollout(NamedTuple):
    """The end of a game, or of each game of a batch.

    Attributes:
        end: `End`, (...).
        time_s: when, (...).
        pursuer_m: final position of the pursuer, (..., 3).
        evader_m: final position of the evader, (..., 3).
        distance_m: final distance of the evader from its target, (...), NaN without one; of the pursuer with `Paper`.
        path: every sample if asked for, else empty; a game that has ended stays where it is.
    """

    end: Array
    time_s: Array
    pursuer_m: Array
    evader_m: Array
    distance_m: Array
    path: tuple[Sample, ...]


def rollout(
    game: Game,
    pursuer: Array,
    evader: Array,
    target: Array | None = None,
    *,
    pursuer_policy: str | Policy = "optimal",
    evader_policy: str | Policy = "optimal",
    stepping: Exact | Paper = EXACT,
    duration_s: float = 600.0,
    keep_path: bool = False,
) -> Rollout:
    """Play a game to its end.

    Args:
        game: what is played, with up-to-date information (τ = 0).
        pursuer: initial position P, (..., 3), m.
        evader: initial position E, (..., 3), m.
        target: initial position T, (..., 3), m, or None for PE; it moves as the game says.
        pursuer_policy: a name in `PURSUER_POLICIES`, or a policy.
        evader_policy: a name in `EVADER_POLICIES`, or a policy.
        stepping: how time advances.
        duration_s: when to stop at the latest.
        keep_path: whether to keep every sample.

    Raises:
        ConfigError: as `solve`; an unknown policy; or information that is not up to date.
    """
    require("duration_s", duration_s)
    if not is_zero(game.information_age_s):
        raise ConfigError(
            f"information_age_s = {game.information_age_s!r}: a rollout keeps no past to look at; must be 0"
        )
    xp, given = vectors({"pursuer": pursuer, "evader": evader} | ({} if target is None else {"target": target}))
    pursuer, evader, target = given["pursuer"], given["evader"], given.get("target")
    shape = leading_shape(game, given)
    velocities = _velocities(game, pursuer_policy, evader_policy)
    nought = spread(xp, shape, pursuer, 0.0)
    start = Sample(
        nought,
        pursuer + nought[..., None],
        evader + nought[..., None],
        None if target is None else target + nought[..., None],
        choose(xp, nought == 0, int(End.RUNNING), int(End.NO_ANSWER)),
    )
    path = []
    with quiet(xp):
        samples = (
            exact_samples(xp, game, start, velocities, stepping, duration_s)
            if isinstance(stepping, Exact)
            else published_samples(xp, game, start, velocities, stepping, duration_s)
        )
        for last in samples:
            if keep_path:
                path.append(last)
        place = last.evader_m if isinstance(stepping, Exact) else last.pursuer_m
        distance = nought * math.nan if last.target_m is None else norm3(xp, last.target_m - place)
    return Rollout(last.end, last.time_s, last.pursuer_m, last.evader_m, distance, tuple(path))


def _velocities(game: Game, pursuer_policy: str | Policy, evader_policy: str | Policy) -> Velocities:
    """Return both players' velocities as one function; two optimal players are solved once."""
    if pursuer_policy == "optimal" and evader_policy == "optimal":

        def both(P: Array, E: Array, T: Array | None, seen: Array) -> tuple[Array, Array]:
            solution = solve(game, P, E, T, evader_velocity_m_s=seen)
            return solution.pursuer_velocity_m_s, solution.evader_velocity_m_s

        return both
    chase = _policy("pursuer_policy", pursuer_policy, PURSUER_POLICIES)
    flee = _policy("evader_policy", evader_policy, EVADER_POLICIES)

    def each(P: Array, E: Array, T: Array | None, seen: Array) -> tuple[Array, Array]:
        return chase(game, P, E, T, seen), flee(game, P, E, T, seen)

    return each


def _policy(name: str, policy: str | Policy, catalogue: Mapping[str, Policy]) -> Policy:
    if not isinstance(policy, str):
        return policy
    if policy not in catalogue:
        raise ConfigError(
            f"{name} = {policy!r}: must be one of {', '.join(catalogue)}, or a function "
            "`Policy`; strategies with a memory and courses are played by scenarios"
        )
    return catalogue[policy]
