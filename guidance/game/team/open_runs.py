"""Headings along which an evader runs some length before any pursuer captures it.

A pursuer closes the headings within an angle φ of the direction to it: with W the vector to it from where the air has
carried the evader's start, and s the level distance within which it captures after a run of length ρ,

    cos φ = (ρ² + ‖W‖² − s²) / (2 ρ ‖W‖),    s = R + √((δρ + l)² − z²).

The longer the run, the more headings are closed. The longest run is the one of the last open heading, for any number
of pursuers. Its length is found by bisection, so it is never missed.
"""

import numpy as np

from guidance.game.arrays import NUMPY, Array
from guidance.game.team.regions import PlaneArrays, Regions

DOUBLINGS = 60
"""Most doublings of the length; no longest run is so much longer than one that was found."""

HALVINGS = 60
"""Bisections: the length is right to the last bit."""


def leaves_open(regions: Regions, length: Array) -> Array:
    """Return whether a run of some length, (...), leaves a heading open, (...)."""
    gap = _gaps(regions, length)[0]
    return np.asarray(gap.max(axis=-1) > 0.0)


def longest_open(regions: Regions, least: Array) -> tuple[PlaneArrays, Array, Array]:
    """Return the end of the longest run, (...), m, and the numbers of the two pursuers that close its heading, (...).

    Args:
        regions: of the pursuers, (..., n).
        least: a length that leaves a heading open, (...), m.
    """
    low = least
    high = least
    for _ in range(DOUBLINGS):
        is_open = leaves_open(regions, high)
        if not is_open.any():
            break
        high = np.where(is_open, 2.0 * high, high)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        is_open = leaves_open(regions, middle)
        low = np.where(is_open, middle, low)
        high = np.where(is_open, high, middle)
    gap, angle, before, after = _gaps(regions, low)
    widest = gap.argmax(axis=-1)[..., None]
    heading = np.take_along_axis(angle, widest, axis=-1)[..., 0]
    first = np.take_along_axis(before, widest, axis=-1)[..., 0]
    second = np.take_along_axis(after, widest, axis=-1)[..., 0]
    run = low * np.cos(heading), low * np.sin(heading)
    return run, np.minimum(first, second), np.maximum(first, second)


def _gaps(regions: Regions, length: Array) -> tuple[Array, Array, Array, Array]:  # noqa: PLR0914
    """Return the open angles behind each pursuer's closed ones, (..., n), rad, negative if there are none.

    Returns:
        The angles, their middles, and the numbers of the pursuers on both sides.
    """
    rho = np.asarray(length)[..., None]
    x = regions.x + regions.wind_x * rho
    y = regions.y + regions.wind_y * rho
    apart = NUMPY.norm2((x, y))
    sphere = regions.ratio * rho + regions.capture
    square = sphere * sphere - regions.z * regions.z
    level = regions.radius + np.sqrt(np.maximum(square, 0.0))
    cosine = (rho * rho + apart * apart - level * level) / (2.0 * rho * apart)
    closes = (square >= 0.0) & (rho > regions.safe)
    half = np.where(closes, np.arccos(np.clip(cosine, -1.0, 1.0)), -1.0)
    direction = np.arctan2(y, x)
    count = half.shape[-1]
    begin = direction - half
    order = np.argsort(np.where(closes, begin % (2.0 * np.pi), np.inf), axis=-1)
    begin = np.take_along_axis(begin % (2.0 * np.pi), order, axis=-1)
    width = np.take_along_axis(2.0 * half, order, axis=-1)
    closing = np.take_along_axis(closes + 0 * order, order, axis=-1)
    # Twice around, so that the farthest end so far is known at every beginning
    begins = np.concatenate([begin, begin + 2.0 * np.pi], axis=-1)
    ends = begins + np.where(np.tile(closing, 2), np.tile(width, 2), -np.inf)
    farthest = np.maximum.accumulate(ends, axis=-1)
    leader = np.maximum.accumulate(np.where(ends >= farthest, np.arange(2 * count), 0), axis=-1)
    gap = begins[..., count:] - farthest[..., count - 1 : -1]
    gap = np.where(closing, gap, -np.inf)
    # Without any pursuer that closes headings, all are open
    nobody = ~closing.any(axis=-1, keepdims=True)
    gap = np.where(nobody, 2.0 * np.pi, gap)
    middle = np.where(nobody, 0.0, begins[..., count:] - 0.5 * gap)
    before = np.take_along_axis(order, leader[..., count - 1 : -1] % count, axis=-1)
    return gap, middle, before, order
