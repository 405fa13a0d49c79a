"""Pictures show what they are given, whatever it is called."""

import pytest

from guidance.errors import OutputError
from guidance.viz.figures import MOST_POINTS, figure_of, literal, save, thinned


@pytest.mark.parametrize("title", [r"$\frac{", "$1 or 2$", r"costs 3$ \alpha", "ordinary"])
def test_a_title_is_read_as_it_is_written(tmp_path, title):
    figure = figure_of(2.0, 1.0)
    text = figure.suptitle(literal(title))
    save(figure, tmp_path / "a.png")
    plain = figure.suptitle(title)
    plain.set_parse_math(False)
    drawn, meant = (one.get_window_extent().width for one in (text, plain))
    assert drawn == pytest.approx(meant, rel=0.05)
    assert (tmp_path / "a.png").stat().st_size > 0


@pytest.mark.parametrize("name", ["none/a.png", "a.foo"])
def test_a_picture_that_cannot_be_written_is_one_clear_error(tmp_path, name):
    with pytest.raises(OutputError, match=r"cannot be written \(.*\); choose another file"):
        save(figure_of(1.0, 1.0), tmp_path / name)


def test_a_long_curve_keeps_both_ends():
    import numpy as np

    curve = np.arange(3.0 * 10 * MOST_POINTS).reshape(-1, 3)
    kept = thinned(curve)
    assert len(kept) == MOST_POINTS
    assert (kept[0] == curve[0]).all()
    assert (kept[-1] == curve[-1]).all()
