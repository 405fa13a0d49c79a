"""From a scenario file to what the flight, the cycle and the evader need."""

import math

import numpy as np

from guidance.autopilots import profile
from guidance.cycle import CycleSettings
from guidance.flight import AfterCapture, FlightSettings
from guidance.following.handling import handling
from guidance.frames import Amsl
from guidance.game import Ball, Cylinder, Game, SpeedSet, StandOff
from guidance.limits import Envelope, StandOffLimit
from guidance.scenarios.courses import evader_strategy, pursuer_strategy
from guidance.scenarios.evader import EvaderSettings
from guidance.scenarios.model import Scenario

# The limits keep this much out of the way of the disc that the game is played to, so that they bind only when something
# is wrong.
_STANDOFF_SLACK_M = 1.0


def site(scenario: Scenario) -> tuple[float, float, Amsl]:
    """Return where the game frame has its zero: on the evader's plane."""
    where = scenario.site
    return where.latitude_deg, where.longitude_deg, Amsl(where.altitude_amsl_m + scenario.evader.height_m)


def speed_set(scenario: Scenario) -> SpeedSet:
    """Return the pursuer's speeds as the game knows them."""
    pursuer = scenario.pursuer
    if pursuer.speed_set == "ball":
        return Ball(pursuer.speed_m_s)
    return Cylinder(pursuer.speed_m_s, pursuer.climb_m_s, pursuer.descent_m_s)


def standoff(scenario: Scenario) -> StandOff:
    """Return the terminal disc, its height above the evader's plane."""
    return StandOff(scenario.standoff.radius_m, scenario.standoff.height_m - scenario.evader.height_m)


def game(scenario: Scenario) -> Game:
    """Return the game of a scenario as the evader, who knows its own speed, plays it in flight."""
    return Game(speed_set(scenario), scenario.evader.speed_m_s, standoff=standoff(scenario))


def target_game_m(scenario: Scenario) -> tuple[float, float, float] | None:
    """Return the place that the evader wants to reach, in the game frame."""
    return None if scenario.target is None else (*scenario.target.position_m, 0.0)


def flight_settings(scenario: Scenario) -> FlightSettings:
    """Return the pursuer's flight."""
    pursuer = scenario.pursuer
    start = (*pursuer.position_m[:2], pursuer.position_m[2] - scenario.evader.height_m)
    flown = handling(pursuer.autopilot)
    envelope = Envelope(
        floor_m=scenario.limits.floor_m,
        ceiling_m=scenario.limits.ceiling_m,
        **scenario.speed_limits._asdict(),
        acceleration_m_s2=flown.acceleration_m_s2,
        vertical_acceleration_m_s2=flown.vertical_acceleration_m_s2,
        jerk_m_s3=flown.jerk_m_s3,
        braking_m_s2=flown.braking_m_s2,
        vertical_braking_m_s2=flown.vertical_braking_m_s2,
        reaction_s=flown.reaction_s,
        yaw_rate_rad_s=math.radians(45.0),
        fence_radius_m=scenario.limits.fence_radius_m,
        fence_margin_m=1.0,
        stand_off=StandOffLimit(
            radius_m=max(0.5, scenario.standoff.radius_m - _STANDOFF_SLACK_M),
            height_m=max(0.5, standoff(scenario).height_m - _STANDOFF_SLACK_M),
        ),
    )
    return FlightSettings(
        profile=profile(pursuer.autopilot),
        cycle=CycleSettings(
            speed_set=speed_set(scenario),
            strategy=pursuer_strategy(scenario, np.array(start), speed_set(scenario), scenario.seed),
            declared_evader_speed_m_s=scenario.evader.believed_speed_m_s,
            standoff=standoff(scenario),
            tolerance_m=scenario.standoff.tolerance_m,
            envelope=envelope,
            following=flown.following,
            acceleration=flown.acceleration,
            target_game_m=target_game_m(scenario),
            site=site(scenario),
        ),
        takeoff_height_m=pursuer.takeoff_height_m,
        start_game_m=start,
        after_capture=AfterCapture.HOLD,
    )


def evader_settings(scenario: Scenario) -> EvaderSettings:
    """Return the evader's play."""
    evader = scenario.evader
    strategy = evader_strategy(scenario, np.array((*evader.position_m, 0.0)), evader.speed_m_s, scenario.seed)
    return EvaderSettings(game(scenario), strategy, target_game_m(scenario), site(scenario))
