"""The search for a heading converges without bisection, and bisection finds the same heading."""

from dataclasses import replace

import numpy as np
import pytest

from guidance.game import StandOff, region, solve
from guidance.game.arrays import NUMPY
from guidance.game.headings import clipped

NAMES = (
    "capture_radius", "age", "ball_standoff", "wind", "ball_everything", "cylinder_everything", "moving_target",
    "moving_target_cylinder",
)  # fmt: skip


def searched(game, oracle, monkeypatch, length, speed):
    """Return the arguments of the search, in other units, for random states that the pursuer wins."""
    P, E, T = (length * place for place in oracle.states(8, 600, game))
    game = replace(
        game,
        pursuer=type(game.pursuer)(
            *(speed * getattr(game.pursuer, name) for name in game.pursuer.__slots__)
        ),
        evader_speed_m_s=speed * game.evader_speed_m_s,
        wind_m_s=tuple(speed * part for part in game.wind_m_s),
        target_velocity_m_s=tuple(speed * part for part in game.target_velocity_m_s),
        capture_radius_m=length * game.capture_radius_m,
        standoff=StandOff(length * game.standoff.radius_m, length * game.standoff.height_m),
        information_age_s=length / speed * game.information_age_s,
    )
    wins = solve(game, P, E, T).winner > 0
    asked = []
    function = region.search

    def asking(xp, *rest):
        asked.append(rest)
        return function(xp, *rest)

    monkeypatch.setattr(region, "search", asking)
    solve(game, P[wins], E[wins], T[wins])
    monkeypatch.undo()
    ((hunt, within),) = asked
    return hunt, np.broadcast_to(within, hunt.ahead[0].shape)


def counted(monkeypatch, name):
    """Record the rows of every later call of a function of `region`."""
    rows = []
    function = getattr(region, name)

    def counting(xp, hunt, aim, *rest):
        rows.append(np.size(aim.s))
        return function(xp, hunt, aim, *rest)

    monkeypatch.setattr(region, name, counting)
    return rows


@pytest.mark.parametrize("units", [(1.0, 1.0), (2.0**-9, 4.0)])
@pytest.mark.parametrize("name", NAMES)
def test_the_search_stays_short_and_the_bracket_alone_finds_the_same(
    games, oracle, monkeypatch, name, units
):
    hunt, within = searched(games[name], oracle, monkeypatch, *units)
    steps = counted(monkeypatch, "newton")
    bracketed = counted(monkeypatch, "bracket")
    found = region.search(NUMPY, hunt, within)
    monkeypatch.undo()
    assert sum(steps[1:]) <= within.size
    assert sum(bracketed) == 0
    asked = counted(monkeypatch, "settled")
    start = region.touch(NUMPY, hunt)
    alone = region.bracket(NUMPY, hunt, start, region.MORE_STEPS)
    assert len(asked) <= 6
    np.testing.assert_allclose(alone.s[~within], found.s[~within], atol=1e-8)


@pytest.mark.parametrize("end", [-1.0, 1.0])
@pytest.mark.parametrize("name", NAMES)
def test_the_bracket_finds_the_heading_from_either_end(games, oracle, monkeypatch, name, end):
    hunt, within = searched(games[name], oracle, monkeypatch, 1.0, 1.0)
    found = region.search(NUMPY, hunt, within)
    start = region.touch(NUMPY, hunt)
    rounds = counted(monkeypatch, "settled")
    with np.errstate(all="ignore"):
        alone = region.bracket(
            NUMPY, hunt, start._replace(s=np.full_like(start.s, end)), region.MORE_STEPS
        )
    assert len(rounds) <= 7
    np.testing.assert_allclose(alone.s[~within], found.s[~within], atol=1e-8)


def test_a_heading_is_kept_within_ninety_degrees():
    s = np.array([-3.0, -1.5, -1.0, -0.5, 0.0, 1.0, 1.5, 3.0])
    np.testing.assert_array_equal(clipped(NUMPY, s), np.clip(s, -1.0, 1.0))
