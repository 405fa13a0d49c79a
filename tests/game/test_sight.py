"""The edges of a target as both players see them: derivatives of the margin, and where the search begins."""

import numpy as np
import pytest

from guidance.game.arrays import NUMPY
from guidance.game.sight import SeenArc, SeenLine

STEP = 1e-5


def courses():
    rng = np.random.default_rng(3)
    apart, between, height, aside = rng.uniform(1.0, 30.0, (4, 200))
    line = SeenLine(
        u=3.0,
        v=2.0,
        apart_square=apart * apart,
        between=between,
        height_square=height * height,
    )
    pursuer = (between - 15.0, aside)
    arc = SeenArc(
        u=3.0, v=2.0, radius=6.0, apart=apart, pursuer=pursuer, height_square=height * height
    )
    # A position on a line is a length, and on a circle a tangent.
    return {
        "line": (line, line.refracted(NUMPY, 0.0 * apart)),
        "circle": (arc, arc.refracted(NUMPY)),
    }


@pytest.mark.parametrize("kind", ["line", "circle"])
@pytest.mark.parametrize("shift", [-0.2, 0.0, 0.3])
def test_bend_and_twist_are_the_derivatives_of_the_slope(kind, shift):
    course, position = courses()[kind]
    position = position + shift
    pose = course.pose(NUMPY, position)
    before = course.pose(NUMPY, position - STEP)
    after = course.pose(NUMPY, position + STEP)
    np.testing.assert_allclose((after.slope - before.slope) / (2.0 * STEP), pose.bend, atol=1e-7)
    np.testing.assert_allclose((after.bend - before.bend) / (2.0 * STEP), pose.twist, atol=1e-6)


@pytest.mark.parametrize("kind", ["line", "circle"])
def test_the_search_begins_where_the_margin_is_nearly_level(kind):
    course, position = courses()[kind]
    assert np.quantile(abs(course.pose(NUMPY, position).slope) * course.v, 0.9) < 0.15
