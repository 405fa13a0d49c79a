"""From a scenario file to what the flight and the cycle need."""

import math

import numpy as np

from guidance.autopilots import profile
from guidance.control import Envelope, StandOffLimit
from guidance.control.handling import handling
from guidance.cycle import CycleSettings
from guidance.flight import AfterCapture, FlightSettings
from guidance.sim.players import pursuer_strategy, site, speed_set, standoff, target_game_m
from guidance.sim.scenario import Scenario

# The limits keep this much out of the way of the disc that the game is played to, so that they bind only when something
# is wrong.
_STANDOFF_SLACK_M = 1.0


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
