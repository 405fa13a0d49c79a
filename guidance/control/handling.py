"""How each autopilot's vehicle is flown: how it follows the game, and the envelope's dynamic limits, as data.

Sources: our own measurements of PX4 v1.17 (SIH quadrotor) and ArduCopter 4.5.7 (its simulated quadrotor), default
parameters. A vehicle that handles differently gets numbers of its own in its configuration.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from guidance.control.approach import Approach
from guidance.control.catch_up import CatchUp
from guidance.control.follow import Following
from guidance.control.late_start import Acceleration
from guidance.control.servo import ServoGains
from guidance.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Handling:
    """One vehicle's handling.

    `acceleration` is what the vehicle surely achieves, by which the time that it needs is told: the autopilot's own
    parameter (PX4's MPC_ACC_HOR and MPC_ACC_DOWN_MAX, ArduCopter's WPNAV_ACCEL and WPNAV_ACCEL_Z) at its default. The
    last six are of `guidance.control.Envelope`, with its names and meanings.
    """

    following: Following
    acceleration: Acceleration
    acceleration_m_s2: float
    vertical_acceleration_m_s2: float
    jerk_m_s3: float
    braking_m_s2: float
    vertical_braking_m_s2: float
    reaction_s: float


PX4 = Handling(
    following=Following(
        # PX4 shapes nothing itself. MPC_TILTMAX_AIR 45° gives 9.8 m/s², of which drag takes 6 at 6 m/s (that airframe
        # flies no faster than 10 m/s); most airframes have far less, so that little is assumed and the rest learned.
        servo=ServoGains(
            acceleration_m_s2=7.0,
            vertical_acceleration_m_s2=2.0,
            jerk_m_s3=60.0,
            lag_s=0.3,
            drag_per_s=0.3,
            drag_limit_per_s=1.5,
            trim_limit_m_s2=1.5,
            drag_learning_per_s2=2.0,
            trim_learning_per_s2=0.3,
        ),
        # It brakes before the stand-off does: a limit that acts takes the fed acceleration away, drag's share too.
        approach=Approach(braking_m_s2=2.5, vertical_braking_m_s2=2.0, lag_s=0.25, vertical_settle_s=0.4, margin_m=0.1),
        catch_up=CatchUp(),
    ),
    acceleration=Acceleration(ground_m_s2=3.0, vertical_m_s2=3.0),
    acceleration_m_s2=9.0,
    vertical_acceleration_m_s2=3.0,
    jerk_m_s3=80.0,
    braking_m_s2=3.0,
    vertical_braking_m_s2=2.0,
    reaction_s=0.35,
)

ARDUCOPTER = Handling(
    following=Following(
        # WPNAV_ACCEL 2.5 m/s² bounds ArduCopter's own correction, ANGLE_MAX 30° the sum at 5.7 m/s², PSC_JERK_XY 5 m/s³
        # both. Its velocity is within 1 % of the setpoint, so that nothing is learned. WPNAV_ACCEL_Z is 1 m/s².
        # Beside drag it gathers speed with some 3.5 m/s²: a reference that runs ahead of it costs a second at the end.
        servo=ServoGains(acceleration_m_s2=4.0, vertical_acceleration_m_s2=1.5, jerk_m_s3=9.0),
        approach=Approach(braking_m_s2=2.5, vertical_braking_m_s2=0.9, lag_s=0.15, settle_s=0.2),
        catch_up=CatchUp(),
    ),
    acceleration=Acceleration(ground_m_s2=2.5, vertical_m_s2=1.0),
    acceleration_m_s2=5.0,
    vertical_acceleration_m_s2=2.0,
    jerk_m_s3=20.0,
    braking_m_s2=2.3,
    vertical_braking_m_s2=0.8,
    reaction_s=0.4,
)

HANDLING: Mapping[str, Handling] = MappingProxyType({"px4": PX4, "arducopter": ARDUCOPTER})


def handling(autopilot: str) -> Handling:
    """Look the handling of an autopilot up by its profile's name.

    Raises:
        ConfigError: If there is no such flavour.
    """
    try:
        return HANDLING[autopilot]
    except KeyError:
        raise ConfigError(f"autopilot = {autopilot!r}: allowed are {', '.join(HANDLING)}") from None
