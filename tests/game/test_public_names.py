import doctest
from importlib.metadata import version

import pytest

import guidance
from guidance import game


def test_a_game_is_written_as_it_is_made_with_nothing_that_is_switched_on_by_itself():
    paper = game.Game(game.Ball(2.0), 1.0)
    assert eval(repr(paper), vars(game)) == paper
    assert paper.standoff == game.StandOff(0.0, 0.0)
    assert (paper.capture_radius_m, paper.information_age_s, paper.wind_m_s) == (
        0.0,
        0.0,
        (0.0, 0.0),
    )
    assert game.Exact() == game.Exact(step_s=0.01, order=4)
    assert game.Paper() == game.Paper(step_s=0.01, capture_m=0.01)


def test_the_packages_example_runs():
    ran = doctest.testmod(game)
    assert ran.attempted >= 3
    assert ran.failed == 0


def test_the_version_is_that_of_what_is_installed():
    assert guidance.__version__ == version("pursuit-guidance")
    with pytest.raises(AttributeError, match="no attribute 'versions'"):
        guidance.versions  # noqa: B018 - asked for in vain
