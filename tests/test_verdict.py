"""The vehicle's verdict in flown TAD games: what was claimed comes true. `bench_verdict` flies a thousand."""

import math

import pytest

from tests.harness.guarded import draw_game, fly

pytestmark = pytest.mark.flight
FLIGHTS = [number if number < 4 else pytest.param(number, marks=pytest.mark.long) for number in range(12)]


@pytest.mark.parametrize("number", FLIGHTS)
def test_an_evader_that_cannot_reach_its_target_does_not_arrive(number):
    game = fly(draw_game(1, number))
    assert game.end in {"captured", "arrived"}
    if game.end == "arrived":
        assert math.isnan(game.claimed_s)
        assert math.isnan(game.reported_s)
