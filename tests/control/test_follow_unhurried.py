"""A vehicle that is behind takes its time for the height, and never arrives too high for it."""

import math

from hypothesis import given
from hypothesis import strategies as st

from guidance.control.follow import Gaps, Pace, catch_up
from guidance.frames import Ned

A_M_S = 8.0
V_M_S = 4.0
B_M_S = 1.65
MEETING_M_S = A_M_S + V_M_S
DT_S = 0.01


def unhurried(wanted, gaps, behind_m):
    """Within speed limits that leave nothing to catch up with over the ground, so that only the height changes."""
    return catch_up(Ned(wanted), Ned((0.0, 0.0, 0.0)), behind_m, gaps, Pace(0.0, 1.0, MEETING_M_S))[
        0
    ]


@given(
    st.tuples(*(st.floats(-9.0, 9.0) for _ in range(3))).map(Ned),
    st.floats(-5.0, 80.0),
    st.floats(-30.0, 30.0),
    st.floats(0, 9),
)
def test_only_the_vertical_speed_changes_and_what_is_left_reaches_the_height_in_time(
    wanted, away_m, above_m, behind_m
):
    north, east, down = unhurried(wanted, Gaps(away_m, above_m, Ned((1.0, 0.0, 0.0))), behind_m)
    assert (north, east) == wanted[:2]
    assert abs(down) <= abs(wanted[2]) + 1e-12
    assert down * wanted[2] >= -1e-12
    enough = abs(above_m) * MEETING_M_S / max(away_m, 1e-3)
    assert abs(down) >= min(abs(wanted[2]), enough) - 1e-12


def test_a_vehicle_that_is_not_behind_flies_as_the_game_does():
    assert unhurried((8.0, 0.0, B_M_S), Gaps(60.0, 2.0, Ned((1.0, 0.0, 0.0))), 0.0) == (
        8.0,
        0.0,
        B_M_S,
    )


def test_a_vehicle_that_is_behind_saves_descent_after_the_first_moment():
    _, _, down = unhurried((8.0, 0.0, B_M_S), Gaps(60.0, 2.0, Ned((1.0, 0.0, 0.0))), 6.0)
    assert math.isclose(down, 2.0 * 12.0 / 60.0)


@given(
    st.floats(5.0, 80.0),
    st.floats(0.1, 20.0),
    st.lists(st.booleans(), min_size=8, max_size=8),
    st.floats(0.2, 4.0),
)
def test_it_is_at_the_height_as_soon_as_the_hurried_one_or_as_it_meets_the_evader(
    away_m, above_m, turns, every_s
):
    """The evader runs away or at the vehicle in turns. Both vehicles fly the game's way over the ground."""
    hurried_m = above_m
    played_s = 0.0
    while away_m > 0.0:
        wanted = (A_M_S, 0.0, min(B_M_S, above_m / DT_S))
        _, _, down = unhurried(wanted, Gaps(away_m, above_m, Ned((1.0, 0.0, 0.0))), 6.0)
        flees = turns[int(played_s / every_s) % len(turns)]
        away_m -= (A_M_S - V_M_S if flees else MEETING_M_S) * DT_S
        above_m = above_m - down * DT_S
        hurried_m = max(0.0, hurried_m - B_M_S * DT_S)
        played_s += DT_S
    assert above_m <= hurried_m + B_M_S * DT_S + 1e-9
