"""Pictures show any name as plain text."""

import subprocess
import sys

import pytest

from guidance.errors import ConfigError, OutputError
from guidance.log.scene import circle_points, lifted
from guidance.sim.batch import stack
from guidance.sweeps.drawing import titled_figure
from guidance.viz.figures import (
    MOST_POINTS,
    check_picture,
    draw_fence,
    draw_scenario,
    figure_of,
    played,
    save,
    save_twice,
    thinned,
)
from tests.harness.flights import NEAR

IN_VIEW, FAR = (lifted(circle_points((0.0, 0.0, 0.0), radius_m), 0.0) for radius_m in (8.0, 300.0))


@pytest.mark.parametrize(
    "title", [r"$\frac{", r"$\frac{$", "$1 or 2$", r"costs 3$ \alpha", "ordinary"]
)
def test_a_text_is_read_as_it_is_written(tmp_path, title):
    """Text in the title, axis labels, ticks, line labels and notes."""
    figure = figure_of(4.0, 3.0)
    axes = figure.subplots()
    axes.plot([0.0, 1.0], label=title)
    axes.set(title=title, xlabel=title)
    axes.set_xticks([0.0], [title])
    texts = [
        figure.suptitle(title),
        axes.annotate(title, (0.0, 0.5)),
        axes.title,
        axes.xaxis.label,
        *axes.get_xticklabels(),
        *axes.legend().get_texts(),
    ]
    save(figure, tmp_path / "a.png")
    figure.canvas.draw()  # at the resolution of the widths
    for text in texts:
        meant = figure.text(
            0.0, 0.0, title, parse_math=False, fontproperties=text.get_fontproperties()
        )
        drawn_px, meant_px = (one.get_window_extent().width for one in (text, meant))
        assert drawn_px == pytest.approx(meant_px, rel=0.05)
    assert (tmp_path / "a.png").stat().st_size > 0


def test_no_picture_is_written_through_a_symbolic_link(tmp_path):
    for kind in ("png", "pdf"):
        (tmp_path / f"a.{kind}").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match="symbolic links"):
        save(figure_of(4.0, 3.0), tmp_path / "a.png")
    with pytest.raises(OSError, match="symbolic links"):
        save_twice(figure_of(4.0, 3.0), tmp_path / "a", dpi=50)
    assert not (tmp_path / "elsewhere").exists()


def test_a_scenario_may_be_called_what_would_be_a_formula(tmp_path):
    """Catches a title that matplotlib reads as a formula.

    Its title goes into the picture of the scenario, and of a sweep over it.
    """
    scenario = NEAR.model_copy(update={"title": r"$\frac{$"})
    draw_scenario(scenario, tmp_path / "scenario.png")
    save(titled_figure(scenario.title, 1, 1)[0], tmp_path / "sweep.png")
    assert {path.stem for path in tmp_path.iterdir()} == {"scenario", "sweep"}


def test_a_picture_that_cannot_be_written_is_one_clear_error(tmp_path):
    with pytest.raises(OutputError, match=r"cannot be written \(.*\); choose another place"):
        save(figure_of(1.0, 1.0), tmp_path / "none" / "a.png")
    with pytest.raises(ConfigError, match=r"a\.foo: must end in one of .*\.png"):
        check_picture(tmp_path / "a.foo")


def test_a_long_curve_keeps_both_ends():
    import numpy as np

    curve = np.arange(3.0 * 10 * MOST_POINTS).reshape(-1, 3)
    kept = thinned(curve)
    assert len(kept) == MOST_POINTS
    assert (kept[0] == curve[0]).all()
    assert (kept[-1] == curve[-1]).all()


@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_fence_is_drawn_where_it_is_in_view_and_never_widens_it(dimensions):
    axes = figure_of(4.0, 4.0).add_subplot(projection="3d" if dimensions == 3 else None)
    axes.set(xlim=(-5.0, 10.0), ylim=(-5.0, 10.0))
    before = axes.get_xlim(), axes.get_ylim()
    draw_fence(axes, [FAR], dimensions)
    assert not axes.lines
    draw_fence(axes, [IN_VIEW, IN_VIEW + 0.5], dimensions)
    assert sum(line.get_label() == "fence" for line in axes.lines) == 1
    assert (axes.get_xlim(), axes.get_ylim()) == before


def test_the_whole_fence_is_shown_where_that_is_asked_for():
    plan = figure_of(4.0, 4.0).add_subplot()
    plan.plot([0.0, 1.0], [0.0, 1.0])
    draw_fence(plan, [FAR], 2, whole=True)
    assert plan.get_xlim()[0] < -299.0
    assert plan.get_xlim()[1] > 299.0


def test_a_scenario_that_ends_where_it_begins_is_drawn(tmp_path):
    """Catches a picture of a single point."""
    evader = NEAR.evader.position_m
    above = NEAR.pursuer.model_copy(update={"position_m": (*evader[:2], NEAR.standoff.height_m)})
    scenario = NEAR.model_copy(update={"pursuer": above})
    assert len(played(stack([scenario]))[1]) == 1
    draw_scenario(scenario, tmp_path / "scenario.png")
    assert (tmp_path / "scenario.png").stat().st_size > 0


def test_pictures_need_no_more_than_their_extra():
    """Catches a picture that needs another extra's package."""
    code = "import sys, guidance.viz.figures; print({'scipy', 'pyarrow', 'rerun', 'aiohttp'} & set(sys.modules))"
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert said.stdout.strip() == "set()"
