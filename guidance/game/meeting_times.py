"""Times until a pursuer's reach, a growing ball or circle, arrives at a moving evader."""

from collections.abc import Callable

from guidance.game.arrays import Library, Plane, Real, Truth, dot2

TOUCH_M = 1e-9
"""Distance that counts as reached for a pursuer that holds a part it has reached; larger than rounding errors."""

_NEWTON_STEPS = 10
"""Eight reach the last bit even at δ = 1.02; larger speed ratios need four or five."""


def climb(
    xp: Library, y: Plane, m: Plane, cover: Callable[[Plane], Real]
) -> tuple[Real, Plane, Real]:
    """Find the largest t = cover(n) over all directions n, that of y + m t; return t, y + m t and its length.

    With NumPy a row stops once it has converged, so that its result does not depend on the other rows.

    Args:
        xp: array library.
        y: a plane vector now, m.
        m: its rate, m/s.
        cover: time, s, as a function of the direction n in n·(y + m t).
    """

    def at(t: Real) -> tuple[Plane, Real]:
        then = (y[0] + m[0] * t, y[1] + m[1] * t)
        return then, xp.norm2(then)

    t = cover(xp.unit2(y, xp.norm2(y)))
    converged: Truth = False
    for _ in range(_NEWTON_STEPS - 1):
        further = cover(xp.unit2(*at(t)))
        if not xp.differentiates:
            further = xp.select(converged, t, further)
            converged = converged | (further - t <= xp.half_of_digits(further) * further)
        t = further
        if converged is True or (converged is not False and converged.all()):
            break
    return t, *at(t)


def catch_in_ball(xp: Library, u: Real, capture: Real, y: Plane, m: Plane, z: Real) -> Real:
    """Solve ‖(y + m t, z)‖ = u t + capture for its root t ≥ 0, with ‖m‖ < u; zero if it is captured now.

    Args:
        xp: array library.
        u: the pursuer's speed, m/s.
        capture: its reach now, m.
        y: horizontal vector from the pursuer to the evader, m.
        m: the evader's velocity less the wind, m/s.
        z: height of the pursuer above the disc, m, of either sign.
    """
    pace = xp.norm2(m)
    return ball_time(
        xp,
        (u - pace) * (u + pace),
        dot2(y, m) - u * capture,
        dot2(y, y) + z * z - capture * capture,
    )[0]


def ball_time(xp: Library, hand: Real, half: Real, beyond: Real) -> tuple[Real, Real]:
    """Solve hand·t² − 2 half·t − beyond = 0 for its root t ≥ 0, and return √(half² + hand·beyond) with it.

    If `beyond` is not positive, the time is zero.

    Args:
        xp: array library.
        hand: u² − ‖m‖², m²/s², positive.
        half: half of the linear coefficient, m²/s.
        beyond: squared distance less squared reach now, m².
    """
    inside = beyond <= 0
    receding = half >= 0
    out = xp.select(inside, 0.0, beyond)
    delta = xp.sqrt(half * half + hand * out)
    # Libraries that differentiate take the derivative of |half| at zero for zero.
    size = abs(half) if not xp.differentiates else xp.select(receding, half, -half)
    root = size + delta
    t = xp.select(receding, root, out) / xp.select(receding, hand, root)
    return xp.select(inside, 0.0 * t, t), delta
