"""An envelope is refused by the name of the limit that is wrong, and has cautious values where it is told none."""

import math
from dataclasses import fields, replace

import pytest

from guidance.control import Envelope, Limits, Speeds
from guidance.errors import ConfigError
from tests.control.scenes import OPEN


@pytest.mark.parametrize(
    "name",
    [
        "speed_m_s",
        "climb_m_s",
        "descent_m_s",
        "acceleration_m_s2",
        "vertical_acceleration_m_s2",
        "jerk_m_s3",
        "yaw_rate_rad_s",
        "braking_m_s2",
        "vertical_braking_m_s2",
        "reaction_s",
        "fence_radius_m",
    ],
)
def test_a_limit_outside_of_its_bounds_is_refused_by_name_with_the_bounds(name):
    for value in (math.nan, math.inf, -1.0, 0.0, 0.9e-3, 1.1e6):
        with pytest.raises(
            ConfigError, match=rf"^{name} = {value}: allowed is 0.001 to 1000000.0$"
        ):
            replace(OPEN, **{name: value})
    for value in (1e-3, 1e6):
        assert getattr(replace(OPEN, **{name: value}), name) == value


def test_floor_and_ceiling_may_be_as_far_away_as_any_limit():
    assert replace(OPEN, floor_m=-1e6, ceiling_m=1e6).ceiling_m == 1e6


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"floor_m": 30.0, "ceiling_m": 30.0}, "floor_m = 30.0: must be below ceiling_m = 30.0"),
        ({"floor_m": math.nan}, "floor_m = nan"),
        ({"ceiling_m": math.inf}, "ceiling_m = inf"),
        ({"floor_m": -math.inf}, "floor_m = -inf"),
        ({"fence_margin_m": -1.0}, "fence_margin_m = -1.0"),
        ({"fence_margin_m": 5.0, "fence_radius_m": 5.0}, "fence_margin_m = 5.0"),
    ],
)
def test_limits_that_contradict_each_other_are_refused_by_name(values, words):
    with pytest.raises(ConfigError, match=words):
        replace(OPEN, **values)


def test_an_envelope_says_for_itself_how_the_vehicle_brakes_and_nothing_of_fences():
    said = {
        "floor_m": 3.0,
        "ceiling_m": 40.0,
        "speed_m_s": 8.0,
        "climb_m_s": 3.0,
        "descent_m_s": 1.5,
        "acceleration_m_s2": 4.0,
        "vertical_acceleration_m_s2": 2.0,
        "jerk_m_s3": 20.0,
        "yaw_rate_rad_s": 1.0,
    }
    cautious = {
        "braking_m_s2": 2.0,
        "vertical_braking_m_s2": 1.0,
        "reaction_s": 0.6,
        "easing_m_s3": 30.0,
        "home_ned_m": (0.0, 0.0, 0.0),
        "fence_radius_m": None,
        "fence_polygon": None,
        "fence_margin_m": 0.0,
        "floor_margin_m": 0.0,
        "stand_off": None,
    }
    envelope = Envelope(**said)
    assert {
        field.name: getattr(envelope, field.name) for field in fields(envelope)
    } == said | cautious


def test_speed_limits_are_from_the_file_or_10_percent_above_the_game_speed():
    game = Speeds(6.0, 3.0, 1.5)
    assert Limits().speeds(game, section="game") == pytest.approx((6.6, 3.3, 1.65))
    given_one = Limits(speed_m_s=7.0, climb_m_s=3.0).speeds(game, section="game")
    assert given_one == pytest.approx((7.0, 3.0, 1.65))  # as fast as the game is enough
    largest = {"speed_m_s": 33.0, "climb_m_s": 11.0, "descent_m_s": 11.0}
    assert Limits(**largest).speeds(game, section="game") == tuple(largest.values())
    for name, value in largest.items():
        for wrong in (0.0, value + 0.5):
            with pytest.raises(ValueError, match=name):
                Limits(**{name: wrong})
    assert Limits(speed_m_s=0.5).speeds(Speeds(0.4, 3.0, 1.5), section="game").speed_m_s == 0.5
    words = (
        r"^limits\.descent_m_s = 1\.4: must be at least own\.descent_m_s = 1\.5, .*or lower own\."
    )
    with pytest.raises(ValueError, match=words):
        Limits(descent_m_s=1.4).speeds(game, section="own")
