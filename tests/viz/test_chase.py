import pytest

from guidance.viz.chase import draw_fence
from guidance.viz.figures import space_and_plan
from guidance.viz.shapes import circle

NEAR, FAR = circle((0.0, 0.0, 0.0), 8.0), circle((0.0, 0.0, 0.0), 300.0)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_fence_is_drawn_where_it_is_in_view_and_never_widens_it(dimensions):
    _, space, plan = space_and_plan()
    axes = plan if dimensions == 2 else space
    axes.set(xlim=(-5.0, 10.0), ylim=(-5.0, 10.0))
    before = axes.get_xlim(), axes.get_ylim()
    draw_fence(axes, [FAR], 0.0, dimensions)
    assert not axes.lines
    draw_fence(axes, [NEAR, NEAR + 0.5], 0.0, dimensions)
    assert sum(line.get_label() == "fence" for line in axes.lines) == 1
    assert (axes.get_xlim(), axes.get_ylim()) == before


def test_the_whole_fence_is_shown_where_that_is_asked_for():
    _, _, plan = space_and_plan()
    plan.plot([0.0, 1.0], [0.0, 1.0])
    draw_fence(plan, [FAR], 0.0, 2, whole=True)
    assert plan.get_xlim()[0] < -299.0
    assert plan.get_xlim()[1] > 299.0
