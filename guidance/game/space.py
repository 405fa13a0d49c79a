"""The evader of the paper's remark, which moves in all three dimensions: the Apollonius sphere.

P, E and T lie in one plane and neither player gains by leaving it, so the game is the planar one (z_P = 0) played in
that plane; its circle is the sphere's section. The state is folded into it, with the first axis from E to T (PE: from P
to E), solved there, and the answer unfolded. Where all three are on one line the second axis is what rounding left;
what leans towards the first is taken off, so that no velocity is unfolded to more than its bound.
"""

from guidance.game.arrays import Array, Library, Real, Space, Truth, components, root, select
from guidance.game.game import Game
from guidance.game.pe import pursuit
from guidance.game.reach import Geometry, Play
from guidance.game.tad import defence


def play_in_space(xp: Library, game: Game, P: Array, E: Array, T: Array | None, seen: Array | None) -> Play:
    """Play the game of an evader in space; see `solve` for what the answer means.

    Args:
        xp: array library.
        game: of the set Ball, with an evader in space.
        P: position of the pursuer, (..., 3), m.
        E: position of the evader, (..., 3), m.
        T: position of the target, (..., 3), m, or None for PE.
        seen: the evader's observed velocity, (..., 3), m/s, or None.
    """
    evader = components(E)
    to_evader = _minus(evader, components(P))
    first, far = _unit(xp, to_evader if T is None else _minus(components(T), evader))
    along = _dot(to_evader, first)
    second, across = _across(xp, to_evader, first, along)
    nought = 0.0 * along
    if T is None:
        play = pursuit(xp, game, Geometry((nought, nought), nought, (along, nought), along, nought, None))
    else:
        distance = root(xp, along * along + across * across)
        state = Geometry((nought, nought), nought, (along, across), distance, nought, None)
        play = defence(xp, game, state, (far, nought))

    def unfold(v: Space) -> Space:
        return (
            v[0] * first[0] + v[1] * second[0],
            v[0] * first[1] + v[1] * second[1],
            v[0] * first[2] + v[1] * second[2],
        )

    run = unfold(play.meeting)
    meeting = (evader[0] + run[0], evader[1] + run[1], evader[2] + run[2])
    flown = unfold(play.pursuer)
    if seen is not None:
        flown = _follow(xp, game, play.time <= 0, components(seen), flown)
    return play._replace(meeting=meeting, pursuer=flown, evader=unfold(play.evader))


def _across(xp: Library, v: Space, first: Space, along: Real) -> tuple[Space, Real]:
    """Return the direction and length of what a vector has across the first axis."""
    second, across = _unit(xp, (v[0] - along * first[0], v[1] - along * first[1], v[2] - along * first[2]))
    lean = _dot(second, first)
    return (second[0] - lean * first[0], second[1] - lean * first[1], second[2] - lean * first[2]), across


def _follow(xp: Library, game: Game, caught: Truth, seen: Space, flown: Space) -> Space:
    """Keep with a captured evader, at no more than its speed bound."""
    direction, length = _unit(xp, seen)
    pace = select(xp, length > game.evader_speed_m_s, game.evader_speed_m_s, length)
    return (
        select(xp, caught, pace * direction[0], flown[0]),
        select(xp, caught, pace * direction[1], flown[1]),
        select(xp, caught, pace * direction[2], flown[2]),
    )


def _minus(a: Space, b: Space) -> Space:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _dot(a: Space, b: Space) -> Real:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _unit(xp: Library, v: Space) -> tuple[Space, Real]:
    """Direction and length; the x axis where the length is zero."""
    length = root(xp, _dot(v, v))
    some = length > 0
    inverse = 1.0 / select(xp, some, length, 1.0)
    return (select(xp, some, v[0] * inverse, 1.0), v[1] * inverse, v[2] * inverse), length
