"""Several pursuers against one evader.

TAD: the evader owns the points that it reaches before every pursuer, the intersection of the discs of `discs`. That is
convex, so that one point X* of it is closest to the target, and the value of the game is

    L = dist(T, ∩ᵢ discᵢ).

The team wins as soon as one pursuer wins alone: T is out of the intersection only where it is out of a disc. A second
pursuer makes L larger, and more than two never bind. Those that bind fly straight to X*; then L never falls, whatever
the evader does, since the multipliers of X* that weigh what the pursuers gain weigh what the evader gains, too. Those
that do not bind are free, and fly to X* here.

PE: no value in closed form is known. What is known is given: the team captures no later than the best of its pursuers
alone (`value`), and no sooner than the evader is at the farthest point of the intersection (`lower_bound`), a play that
Von Moll et al. (2019) find optimal in open loop only. Every pursuer plays its own game here, so that each keeps its own
guarantee, and the evader runs to that point.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game import Ball, Game, Reason, Solution, solve
from guidance.game.team.discs import Array, Discs, Point, farthest, project, taken

ALLOWED: dict[str, Any] = {
    "capture_radius_m": 0.0,
    "information_age_s": 0.0,
    "wind_m_s": (0.0, 0.0),
    "target_velocity_m_s": (0.0, 0.0),
    "evader_space": "plane",
}
"""What a team's game leaves as it is."""

_NO_DISC = "whose closed form intersects discs: with anything else what the evader reaches first is no disc"


class _Team(NamedTuple):
    """A state by components: speeds, the evader's position, and the discs of the pursuers, all (..., n)."""

    u: Array
    v: Array
    evader: tuple[Array, Array, Array]
    discs: Discs


class _Meeting(NamedTuple):
    """Where the evader ends, from where it is, and which two pursuers decide it, or one alone, twice."""

    point: Point
    first: Array
    second: Array

    @property
    def alone(self) -> Array:
        """Whether one decides alone."""
        return np.asarray(self.first == self.second)


class TeamSolution(NamedTuple):
    """The answer of `solve_team` for leading axes (...) and n pursuers.

    A row without an answer is NaN throughout, its winner UNDECIDED, and its reason tells why.

    Attributes:
        winner: `Winner`: 1 the team, −1 the evader, 0 neither (the barrier itself, or no answer).
        value: TAD: distance of the evader from its target at the capture, m, or, where the evader wins, the distance
            that the nearest pursuer is short of a capture then, m. PE: the time in which the team captures at the
            latest, s; an upper bound of the game's value, which its best pursuer keeps alone.
        lower_bound: TAD: the value again. PE: the time that the evader surely has, s.
        margin_s: how much sooner a pursuer can guard the target than the evader can be there, s; infinite in PE.
        meeting_point_m: where the evader is when the game ends, (..., 3), m: X*; in PE the point that it runs to.
        meeting_time_s: when it is there, from now, s.
        binds: which pursuers decide that point, (..., n): one, or two.
        pursuer_velocity_m_s: velocities of the pursuers, (..., n, 3), m/s.
        evader_velocity_m_s: velocity of the evader, (..., 3), m/s.
        reason: `Reason`: solved, a degenerate state, or why there is no answer.
    """

    winner: Array
    value: Array
    lower_bound: Array
    margin_s: Array
    meeting_point_m: Array
    meeting_time_s: Array
    binds: Array
    pursuer_velocity_m_s: Array
    evader_velocity_m_s: Array
    reason: Array


def solve_team(
    game: Game,
    pursuers: ArrayLike,
    evader: ArrayLike,
    target: ArrayLike | None = None,
    *,
    evader_velocity_m_s: ArrayLike | None = None,
) -> TeamSolution:
    """Solve a game of several pursuers against one evader: PE without a target, TAD with one.

    A team of one has the answer of `solve`, to the bit.

    Args:
        game: the paper's game, at most with a height of the stand-off disc. Speeds may be arrays that broadcast with
            (..., n): (n,) where pursuers differ, (..., 1) where evaders do.
        pursuers: positions, (..., n, 3), NumPy, m.
        evader: position, (..., 3), m.
        target: position of the evader's target, (..., 3), m, or None for PE.
        evader_velocity_m_s: the evader's velocity as observed, (..., 3), where it is known; see `solve`.

    Raises:
        ConfigError: teams do not play such a game, an argument is not an array of its shape, the shapes do not fit
            each other, or a single state has no answer. In a batch such a row is NaN instead.
    """
    u, v = speeds(game)
    if np.shape(v)[-1:] not in {(), (1,)}:
        raise ConfigError(f"evader_speed_m_s = {v!r}: must be one number, or an array (..., 1), for one evader")
    given = {"evader": evader, "target": target, "evader_velocity_m_s": evader_velocity_m_s}
    P = vectors("pursuers", pursuers, "(..., n, 3)")
    rest = {name: vectors(name, one, "(..., 3)") for name, one in given.items() if one is not None}
    axes = {"pursuers": P.shape[:-2], "speed_m_s": np.shape(u)[:-1], "evader_speed_m_s": np.shape(v)[:-1]}
    shape = fitting(axes | {name: one.shape[:-1] for name, one in rest.items()})
    P = np.broadcast_to(P, (*shape, *P.shape[-2:]))
    lone = {name: np.broadcast_to(one, (*shape, 3))[..., None, :] for name, one in rest.items()}
    alone = solve(game, P, lone["evader"], lone.get("target"), evader_velocity_m_s=lone.get("evader_velocity_m_s"))
    with np.errstate(all="ignore"):
        team = _taken_apart(game, P, lone["evader"])
        answer = _pursuit(team, alone) if target is None else _defence(team, alone, lone["target"])
        return _judged(answer, alone, {"pursuers": P, **rest})


def speeds(game: Game) -> tuple[Any, Any]:
    """Return the speeds of pursuers and evader of a game that teams play.

    Raises:
        ConfigError: If it is none, with the key, its value and what is allowed.
    """
    if not isinstance(game.pursuer, Ball):
        raise ConfigError(f"pursuer = {game.pursuer!r}: must be a Ball in a game of teams, {_NO_DISC}")
    given = {name: (getattr(game, name), allowed) for name, allowed in ALLOWED.items()}
    for name, (value, allowed) in {**given, "standoff.radius_m": (game.standoff.radius_m, 0.0)}.items():
        if any(map(np.ndim, value if isinstance(value, tuple) else (value,))) or value != allowed:
            raise ConfigError(f"{name} = {value!r}: must be {allowed!r} in a game of teams, {_NO_DISC}")
    if np.ndim(game.standoff.height_m):
        raise ConfigError(f"standoff.height_m = {game.standoff.height_m!r}: must be one number in a game of teams")
    return game.pursuer.speed_m_s, game.evader_speed_m_s


def with_speeds(game: Game, u: Any, v: Any) -> Game:  # noqa: ANN401 - numbers or arrays
    """Return a game with other speeds."""
    return replace(game, pursuer=Ball(u), evader_speed_m_s=v)


def vectors(name: str, array: ArrayLike, shape: str) -> Array:
    """Return an argument as an array of real numbers.

    Raises:
        ConfigError: If it does not have as many axes as its shape says, at least, its last one is not of length 3, or
            it holds no player where its shape says how many.
    """
    found = np.asarray(array)
    axes = shape.count(",")
    nobody = axes > 1 and 0 in found.shape[-2:-1]
    if found.ndim < axes or nobody or found.shape[-1:] != (3,) or found.dtype.kind not in "fiu":
        raise ConfigError(f"{name} = {array!r}: must be an array of numbers of shape {shape}")
    return found if found.dtype.kind == "f" else found.astype(np.float64)


def fitting(shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Return the common shape of leading axes.

    Raises:
        ConfigError: If they do not fit each other.
    """
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        raise ConfigError(f"the leading shapes do not fit each other: {shapes}") from None


def spoiled(part: Array, sound: Array) -> Array:
    """Return a field of an answer with NaN, or zero where it holds no real numbers, in the rows without an answer."""
    mask = sound[(..., *[None] * (part.ndim - sound.ndim))]
    return np.where(mask, part, np.asarray(np.nan if part.dtype.kind == "f" else 0, dtype=part.dtype))


def _judged(answer: TeamSolution, alone: Solution, given: dict[str, Array]) -> TeamSolution:
    """Spoil the rows without an answer, or refuse a single state that has none."""
    none = int(Reason.NOT_FINITE)
    worst = np.max(alone.reason, axis=-1)
    fault = np.where(worst >= none, worst, np.where(np.isfinite(answer.value), 0, none))
    sound = np.asarray(fault == 0)
    if sound.all():
        return answer
    if sound.ndim == 0:
        wrong = [f"{name} = {array!r}" for name, array in given.items() if not np.isfinite(array).all()]
        why = Reason(int(fault)).word.replace("_", " ")
        raise ConfigError(f"{', '.join(wrong) or 'the team'}: has no answer: {why}")
    parts = {name: spoiled(part, sound) for name, part in answer._asdict().items()}
    return TeamSolution(**parts)._replace(reason=np.where(sound, answer.reason, fault).astype(answer.reason.dtype))


def _taken_apart(game: Game, P: Array, E: Array) -> _Team:
    w, shape = P - E, P.shape[:-1]
    u, v = (np.broadcast_to(np.asarray(speed, dtype=w.dtype), shape) for speed in speeds(game))
    curvature = (u - v) * (u + v) / (v * v)
    evader = np.broadcast_to(E, P.shape)
    discs = Discs(curvature, w[..., 0], w[..., 1], w[..., 2] - game.standoff.height_m)
    return _Team(u, v, (evader[..., 0], evader[..., 1], evader[..., 2]), discs)


def _defence(team: _Team, alone: Solution, T: Array) -> TeamSolution:
    """Play TAD."""
    winner, wins = np.max(alone.winner, axis=-1), alone.winner > 0
    won = winner > 0
    target = T[..., 0] - team.evader[0], T[..., 1] - team.evader[1]
    own = alone.meeting_point_m[..., 0] - team.evader[0], alone.meeting_point_m[..., 1] - team.evader[1]
    nearest = np.where(wins, own[0], target[0]), np.where(wins, own[1], target[1])
    found = project(
        team.discs, (target[0][..., 0], target[1][..., 0]), nearest, np.where(wins, alone.value, 0.0 * alone.value)
    )
    # Nobody stops the evader: the pursuer that comes least short counts, or one that is there at the same instant.
    least = np.argmin(np.where(alone.winner == winner[..., None], alone.value, np.inf), axis=-1)
    first, second = np.where(won, found.first, least), np.where(won, found.second, least)
    meeting = _Meeting(found.point, first, second)
    value = np.where(won, found.distance, taken(alone.value, least))
    return _assembled(team, alone, meeting, first)._replace(
        winner=winner, value=value, lower_bound=value, pursuer_velocity_m_s=_flown(team, alone, meeting, won)
    )


def _pursuit(team: _Team, alone: Solution) -> TeamSolution:
    """Play PE."""
    soonest, value = np.argmin(alone.value, axis=-1), np.min(alone.value, axis=-1)
    heading = alone.evader_velocity_m_s[..., 0] / team.v, alone.evader_velocity_m_s[..., 1] / team.v
    found = farthest(team.discs, heading, alone.value * team.v)
    caught = value <= 0
    first, second = np.where(caught, soonest, found.first), np.where(caught, soonest, found.second)
    answer = _assembled(team, alone, _Meeting(found.point, first, second), soonest)
    bound = np.where(answer.meeting_time_s < value, answer.meeting_time_s, value)
    return answer._replace(value=value, lower_bound=bound, pursuer_velocity_m_s=alone.pursuer_velocity_m_s)


def _assembled(team: _Team, alone: Solution, meeting: _Meeting, lead: Array) -> TeamSolution:
    """Put together what follows from where the evader ends; what one pursuer alone decides is its own answer."""
    (x, y), first, second = meeting
    single = meeting.alone
    v = team.v[..., 0]
    run = np.sqrt(x * x + y * y)
    end = x + team.evader[0][..., 0], y + team.evader[1][..., 0], team.evader[2][..., 0]
    every = np.arange(alone.value.shape[-1])
    value = taken(alone.value, lead)
    return TeamSolution(
        winner=np.max(alone.winner, axis=-1),
        value=value,
        lower_bound=value,
        margin_s=np.max(alone.margin_s, axis=-1),
        meeting_point_m=_vector(single, alone.meeting_point_m, first, end),
        meeting_time_s=np.where(single, taken(alone.meeting_time_s, first), run / v),
        binds=(every == first[..., None]) | (every == second[..., None]),
        pursuer_velocity_m_s=alone.pursuer_velocity_m_s,
        evader_velocity_m_s=_vector(
            single, alone.evader_velocity_m_s, first, (v * (x / run), v * (y / run), 0.0 * run)
        ),
        reason=np.where(single, taken(alone.reason, lead), np.int8(Reason.SOLVED)),
    )


def _flown(team: _Team, alone: Solution, meeting: _Meeting, won: Array) -> Array:
    """Return the velocities of a team that wins, straight to X*, or of one that does not, each its own."""
    x, y = (part[..., None] for part in meeting.point)
    to = x - team.discs.x, y - team.discs.y, 0.0 - team.discs.z
    length = np.sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2])
    rate = np.where(length > 0, team.u / length, 0.0 * length)
    own = (np.arange(alone.value.shape[-1]) == meeting.first[..., None]) & meeting.alone[..., None]
    straight = np.stack([rate * part for part in to], axis=-1)
    return np.where((own | ~won[..., None])[..., None], alone.pursuer_velocity_m_s, straight)


def _vector(single: Array, own: Array, first: Array, parts: tuple[Array, Array, Array]) -> Array:
    """Return a pursuer's own vector where it decides alone, else the one of these components."""
    picked = np.take_along_axis(own, first[..., None, None], axis=-2)[..., 0, :]
    return np.where(single[..., None], picked, np.stack(np.broadcast_arrays(*parts), axis=-1))
