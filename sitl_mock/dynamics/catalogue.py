"""The available vehicles, with parameters from measurements.

Sources of the values:

* Control gains, limits and take-off ramp: documented defaults of PX4 1.17 and ArduCopter 4.5.
* PX4's drag: its simulator's (1 N per m/s on 1 kg), consistent with the measured 9.8 m/s at 45 degrees of tilt. Its
  maximum thrust is twice the weight.
* ArduCopter's drag: its simulator's (3 kg, 15.08 m/s at 45 degrees, rotor disc 0.385 m2, momentum drag 0.2) at 644 m
  above the sea, consistent with the measured top speeds (15.2 m/s at 45 degrees, 10.3 m/s at 30, 11.4 m/s diagonally
  at 30).
* PX4's rate loop and its torque limit, ArduCopter's attitude gain and vertical velocity scale: least squares on the
  recorded steps, each half checked against the other (`tests/data/README.md`).
* Dead times: the measured time to 10 % minus the delay of the client's link.
"""

from typing import Final, Protocol

from sitl_mock.dynamics.ardupilot_control import ArduControl, ArduGains, ArduMemory
from sitl_mock.dynamics.multicopter import Airframe, Multicopter
from sitl_mock.dynamics.px4_control import Px4Control, Px4Memory
from sitl_mock.dynamics.px4_gains import Px4Gains
from sitl_mock.dynamics.rover import Rover
from sitl_mock.dynamics.shaping import Reference, TravelLimits
from sitl_mock.dynamics.values import Body, Estimate, Motion, Setpoint, Surroundings
from sitl_mock.vector import Vector


class Vehicle(Protocol):
    """A kind of vehicle that the mock can move."""

    def reference(self, motion: Motion) -> Reference | None:
        """The reference motion of the controller; None if it has none."""
        ...

    def initial(self, position_ned_m: Vector, yaw_rad: float, *, flying: bool = False) -> Motion:
        """A vehicle at rest."""
        ...

    def estimate(self, body: Body, around: Surroundings) -> Estimate:
        """Estimated position and velocity, as the autopilot reports them."""
        ...

    def step(self, motion: Motion, setpoint: Setpoint, around: Surroundings, dt_s: float) -> Motion:
        """Advance the motion by `dt_s`; pure, so equal arguments give equal motion.

        Args:
            motion: Present motion.
            setpoint: Setpoint in force.
            around: Wind, height of the ground and estimator errors.
            dt_s: Length of the step.
        """
        ...


PX4_AIRFRAME: Final = Airframe(
    attitude_gain_1_s=4.0,
    rate_gain_1_s=14.0,
    lean_rate_max_rad_s=3.84,
    yaw_rate_gain_1_s=4.0,
    thrust_max_m_s2=20.0,
    rotor_lag_s=0.05,
    drag_1_s=1.0,
    drag_1_m=0.0,
    lean_accel_rad_s2=60.0,
)
PX4_TRAVEL: Final = TravelLimits(
    speed_m_s=5.0,
    climb_m_s=3.0,
    sink_m_s=1.5,
    accel_m_s2=3.0,
    accel_z_m_s2=4.0,
    brake_m_s2=3.0,
    jerk_m_s3=4.0,
    jerk_z_m_s3=4.0,
    settle_1_s=4.0,
    straight=True,
)
ARDUCOPTER_AIRFRAME: Final = Airframe(
    attitude_gain_1_s=6.2,
    rate_gain_1_s=50.0,
    lean_rate_max_rad_s=3.14,
    yaw_rate_gain_1_s=5.0,
    thrust_max_m_s2=25.0,
    rotor_lag_s=0.05,
    drag_1_s=0.235,
    drag_1_m=0.0336,
)
ARDUCOPTER_TRAVEL: Final = TravelLimits(
    speed_m_s=10.0,
    climb_m_s=2.5,
    sink_m_s=1.5,
    accel_m_s2=2.5,
    accel_z_m_s2=1.0,
    brake_m_s2=4.0,
    jerk_m_s3=5.0,
    jerk_z_m_s3=5.0,
    settle_1_s=2.0,
)


def px4_quadrotor(
    gains: Px4Gains | None = None,
    travel: TravelLimits = PX4_TRAVEL,
    airframe: Airframe = PX4_AIRFRAME,
) -> Multicopter[Px4Memory]:
    """The quadrotor of PX4's SIH simulator, with PX4's default parameters unless given."""
    if gains is None:
        gains = Px4Gains()
    control = Px4Control(gains, travel, airframe.thrust_max_m_s2)
    return Multicopter(control, Px4Memory, airframe, setpoint_delay_s=0.01)


def arducopter_quadrotor(
    gains: ArduGains | None = None,
    travel: TravelLimits = ARDUCOPTER_TRAVEL,
    airframe: Airframe = ARDUCOPTER_AIRFRAME,
) -> Multicopter[ArduMemory]:
    """The quadrotor of ArduPilot's simulator, with ArduCopter's default parameters unless given."""
    if gains is None:
        gains = ArduGains()
    control = ArduControl(gains, travel, airframe.thrust_max_m_s2)
    return Multicopter(
        control,
        ArduMemory,
        airframe,
        velocity_scale_ned=Vector((1.0, 1.0, 0.971)),
        setpoint_delay_s=0.03,
    )


def rover() -> Rover:
    """A skid-steered ground vehicle."""
    return Rover()
