"""The vehicle's verdict in flown TAD games: what was claimed comes true. `bench_verdict` flies a thousand."""

import math

import pytest

from tests.harness.guarded import draw_game, fly

pytestmark = pytest.mark.flight
FLIGHTS = [pytest.param(1, number, marks=pytest.mark.long) for number in range(12)]
PASSED_BELOW = [(3, 179), (3, 359), (3, 703), (5, 717), (6, 79)]
"""The evader turns when it is 2 to 13 m from the rim. It passes below a vehicle that flies on while it is too high."""
FLOWN_PAST = [(7, 721)]
"""The evader runs away and turns when the vehicle, at full speed and 1.5 m too high, needs 2.5 s to turn with it."""

COMES_STRAIGHT_AT_IT = [("disc", 95), ("moving disc", 23), ("moving disc", 59), ("moving disc", 83)]
"""The evader comes straight at the vehicle, so the worst ways to a wide target are one on each side."""


@pytest.mark.parametrize(("seed", "number"), [*FLIGHTS, *PASSED_BELOW, *FLOWN_PAST])
def test_an_evader_that_cannot_reach_its_target_does_not_arrive(seed, number):
    game = fly(draw_game(seed, number))
    assert game.end in {"captured", "arrived"}
    if game.end == "arrived":
        assert math.isnan(game.claimed_s)
        assert math.isnan(game.reported_s)


@pytest.mark.parametrize(("shape", "number"), COMES_STRAIGHT_AT_IT)
def test_a_claim_at_a_wide_target_is_kept_against_an_evader_that_comes_straight_at_the_vehicle(
    shape, number
):
    game = fly(draw_game(20411, number, shape))
    assert game.sustained_s < game.end_s
    assert game.end == "captured"
