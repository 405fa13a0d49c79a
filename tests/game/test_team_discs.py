"""Points of an intersection of discs, against headings tried one by one and against discs written by their centres."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.game.team.discs import Discs, crossings, excess, farthest, project, rim
from tests.harness.examples import drawn

seeds = st.integers(0, 2**32 - 1)


def random_discs(seed, count, *, ratio=None):
    """Discs of `count` pursuers about the evader, their speed ratios, and a point anywhere."""
    rng = np.random.default_rng(seed)
    ratio = rng.uniform(1.05, 4.0, count) if ratio is None else np.full(count, ratio)
    w = rng.uniform(-20.0, 20.0, (count, 3)) * rng.uniform(0.01, 1.0, (count, 1))
    target = rng.uniform(-60.0, 60.0, 2)
    return Discs((ratio - 1.0) * (ratio + 1.0), *w.T), ratio, w, target


def circles(discs):
    """The same discs by centre and radius, (n, 2) and (n,)."""
    centre = -np.stack([discs.x, discs.y], axis=-1) / discs.curvature[:, None]
    power = discs.x**2 + discs.y**2 + discs.z**2
    return centre, np.sqrt((centre**2).sum(axis=-1) + power / discs.curvature)


def single(discs, target):
    """Each disc's point closest to the target, from its centre and radius, and the distance."""
    centre, radius = circles(discs)
    out = target - centre
    far = np.sqrt((out**2).sum(axis=-1))
    share = np.minimum(1.0, radius / far)[:, None]
    return centre + share * out, np.maximum(far - radius, 0.0)


def projected(discs, target):
    points, distance = single(discs, target)
    with np.errstate(all="ignore"):
        return project(discs, tuple(target), tuple(points.T), distance)


def stretched(discs):
    """The farthest point of the intersection from the evader."""
    centre, radius = circles(discs)
    far = np.sqrt((centre**2).sum(axis=-1))
    with np.errstate(all="ignore"):
        return farthest(discs, tuple((centre / far[:, None]).T), far + radius)


def edge(ratio, w, angle):
    """Distances that an evader gets along headings before any pursuer, by bisection on the definition."""
    n = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    low, high = np.zeros(len(angle)), np.full(len(angle), 1e4)
    for _ in range(80):
        middle = 0.5 * (low + high)
        late = np.linalg.norm(middle[:, None, None] * n[:, None] - w, axis=-1) > ratio * middle[:, None]
        first = late.all(axis=-1)
        low, high = np.where(first, middle, low), np.where(first, high, middle)
    return low[:, None] * n[:, :2]


def searched(ratio, w, cost):
    """The least cost of a point on the edge, over all headings."""
    angle = np.linspace(0.0, 2.0 * np.pi, 2000)
    spread = angle[1]
    best = angle[np.argmin(cost(edge(ratio, w, angle)))]
    for _ in range(14):
        angle = np.linspace(best - spread, best + spread, 81)
        costs = cost(edge(ratio, w, angle))
        best, spread = angle[np.argmin(costs)], spread / 20.0
    return costs.min()


@settings(max_examples=drawn(30), deadline=None)
@given(seed=seeds, count=st.integers(1, 6))
def test_no_reachable_point_is_closer_to_the_target(seed, count):
    discs, ratio, w, target = random_discs(seed, count)
    found = projected(discs, target)
    if found.distance == 0.0:
        assert (excess(discs, tuple(target)) <= 1e-9).all()
        return
    least = searched(ratio, w, lambda x: np.linalg.norm(x - target, axis=-1))
    np.testing.assert_allclose(found.distance, least, rtol=1e-11, atol=1e-11)
    assert (excess(discs, found.point) <= 1e-9 * (1.0 + np.linalg.norm(w, axis=-1) ** 2)).all()
    np.testing.assert_allclose(np.hypot(*(found.point - target)), found.distance, rtol=1e-12, atol=1e-12)


@settings(max_examples=drawn(30), deadline=None)
@given(seed=seeds, count=st.integers(1, 6))
def test_no_reachable_point_is_farther_from_the_evader(seed, count):
    discs, ratio, w, _ = random_discs(seed, count)
    found = stretched(discs)
    most = -searched(ratio, w, lambda x: -np.linalg.norm(x, axis=-1))
    np.testing.assert_allclose(found.distance, most, rtol=1e-11)
    np.testing.assert_allclose(np.hypot(*found.point), found.distance, rtol=1e-12)
    assert (excess(discs, found.point) <= 1e-9 * (1.0 + np.linalg.norm(w, axis=-1) ** 2)).all()


@settings(max_examples=drawn(30), deadline=None)
@given(seed=seeds, count=st.integers(2, 6))
def test_those_that_bind_are_enough(seed, count):
    discs, _, _, target = random_discs(seed, count)
    found = projected(discs, target)
    again = projected(discs.pick(sorted({int(found.first), int(found.second)})), target)
    assert (again.distance, *again.point) == (found.distance, *found.point)


@pytest.mark.parametrize("seed", range(40))
def test_a_corner_far_from_the_evader_names_both_discs(seed):
    discs, _, _, _ = random_discs(seed, 3)
    found = stretched(discs)
    size = 1.0 + discs.x**2 + discs.y**2 + discs.z**2 + discs.curvature * found.distance**2
    met = np.flatnonzero(abs(excess(discs, found.point)) < 1e-11 * size)
    assert set(met.tolist()) == {int(found.first), int(found.second)}


@settings(max_examples=drawn(30), deadline=None)
@given(seed=seeds, count=st.integers(2, 6))
def test_the_order_of_the_discs_changes_no_bit(seed, count):
    discs, _, _, target = random_discs(seed, count)
    order = np.random.default_rng(seed).permutation(count)
    for find in (lambda part: projected(part, target), stretched):
        found, again = find(discs), find(discs.pick(order))
        assert (found.distance, *found.point) == (again.distance, *again.point)
        if found.distance > 0:
            assert {order[again.first], order[again.second]} == {int(found.first), int(found.second)}


@settings(max_examples=drawn(40), deadline=None)
@given(seed=seeds)
def test_where_two_rims_cross_both_are_met(seed):
    discs, _, _, _ = random_discs(seed, 2)
    centre, radius = circles(discs)
    apart = np.linalg.norm(centre[0] - centre[1])
    meet = abs(radius[0] - radius[1]) < apart < radius.sum()
    with np.errstate(all="ignore"):
        for point in crossings(discs.pick(0), discs.pick(1)):
            assert bool(np.isfinite(point).all()) == meet
            if meet:
                size = 1.0 + discs.x**2 + discs.y**2 + discs.z**2 + discs.curvature * np.hypot(*point) ** 2
                assert (abs(excess(discs, point)) < 1e-11 * size).all()


def test_rims_and_corners_keep_their_digits_where_speeds_are_almost_alike():
    """Discs that are all but half-planes: the edge towards the pursuer is the bisector, the one behind is far away."""
    curvature, up = np.full(2, 1e-12), np.zeros(2)
    discs = Discs(curvature, np.array([4.0, 4.0]), np.array([3.0, -3.0]), up)
    assert rim(discs, (0.8, 0.6))[0] == pytest.approx(2.5, rel=1e-11)
    assert rim(discs, (-0.8, -0.6))[0] == pytest.approx(1e13, rel=1e-11)
    corners = crossings(discs.pick(0), discs.pick(1))
    assert min(np.hypot(x - 3.125, y) for x, y in corners) < 1e-10


def test_a_half_plane_is_a_disc_of_speed_ratio_one():
    discs = Discs(np.array([0.0, 1e-300]), np.array([4.0, 0.0]), np.array([0.0, 6.0]), np.zeros(2))
    assert rim(discs, (1.0, 0.0))[0] == 2.0
    one, other = np.array([[2.0, 9.0], [9.0, 3.0]])
    with np.errstate(all="ignore"):
        found = project(discs, (np.float64(9.0), np.float64(9.0)), (one, other), np.array([7.0, 6.0]))
    assert found.point == pytest.approx((2.0, 3.0))
    assert found.distance == pytest.approx(np.hypot(7.0, 6.0))


@pytest.mark.parametrize("close", [1e-3, 1e-8, 1e-13, 0.0])
def test_two_pursuers_beside_each_other_are_worth_one(close):
    rng = np.random.default_rng(5)
    for _ in range(200):
        w = rng.uniform(-20.0, 20.0, 3)
        both = np.stack([w, w + close * rng.uniform(-1.0, 1.0, 3)])
        discs = Discs(np.full(2, 3.0), *both.T)
        target = rng.uniform(-60.0, 60.0, 2)
        alone = single(discs, target)[1].max()
        found = projected(discs, target)
        assert alone <= found.distance <= alone + 3.0 * close
        centre, radius = circles(discs)
        far = (radius + np.linalg.norm(centre, axis=-1)).min()
        assert stretched(discs).distance == pytest.approx(far, abs=3.0 * close + 1e-12)


@pytest.mark.parametrize("ratio", [1.02, 2.0])
@pytest.mark.parametrize("close", [1e-10, 1e-13, 1e-15])
def test_corners_that_are_made_of_rounding_are_not_taken(ratio, close):
    """Rims that differ in their last digits cross anywhere: tens of metres from where the discs are nearest."""
    rng = np.random.default_rng(7)
    w, target = rng.uniform(-20.0, 20.0, (5000, 1, 3)), rng.uniform(-60.0, 60.0, (2, 5000, 1))
    w = w + close * rng.uniform(-1.0, 1.0, (5000, 2, 3))
    discs = Discs(np.full((5000, 2), (ratio - 1.0) * (ratio + 1.0)), *np.moveaxis(w, -1, 0))
    out = [discs.curvature * goal + part for goal, part in zip(target, discs[1:3], strict=True)]
    far = np.hypot(*out)
    root = np.sqrt(discs.curvature * (w**2).sum(axis=-1) + discs.x**2 + discs.y**2)
    distance = np.maximum(excess(discs, tuple(target)) / (far + root), 0.0)
    nearest = tuple(goal - distance * part / far for goal, part in zip(target, out, strict=True))
    with np.errstate(all="ignore"):
        found = project(discs, tuple(target[..., 0]), nearest, distance)
    np.testing.assert_allclose(found.distance, distance.max(axis=-1), rtol=0.0, atol=3.0 * close)


def test_a_batch_is_its_singles():
    rng = np.random.default_rng(8)
    w, target = rng.uniform(-20.0, 20.0, (3, 40, 5)), rng.uniform(-60.0, 60.0, (40, 2))
    whole = Discs(np.broadcast_to(3.0, (40, 5)), *w)
    rows = [Discs(*(part[i] for part in whole)) for i in range(40)]
    points, distance = zip(*[single(row, goal) for row, goal in zip(rows, target, strict=True)], strict=True)
    points, distance = np.array(points), np.array(distance)
    with np.errstate(all="ignore"):
        found = project(whole, (target[:, 0], target[:, 1]), (points[..., 0], points[..., 1]), distance)
    for i, row in enumerate(rows):
        one = projected(row, target[i])
        assert (one.distance, *one.point) == (found.distance[i], found.point[0][i], found.point[1][i])
        assert (one.first, one.second) == (found.first[i], found.second[i])
