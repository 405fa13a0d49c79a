"""The vehicles there are, with the parameters of the ones that were measured.

Where the values come from. Control gains, limits and take-off ramp: documented defaults of PX4 1.17 and ArduCopter 4.5.
PX4's drag: its simulator's own (1 N per m/s on 1 kg), which also gives the 9.8 m/s measured at 45 degrees of tilt; its
thrust: twice the weight. ArduCopter's drag: linear, and quadratic along each axis of the body, from the top speeds
measured (15.2 m/s at 45 degrees, 10.3 m/s at 30, 11.4 m/s over the corner at 30). PX4's rate loop and how hard its
rotors turn it, ArduCopter's attitude gain and vertical velocity scale: least squares on the recorded steps, each half
checked against the other (`tests/data/README.md`). Dead times: what the client's own link leaves of the measured time
to 10 %.
"""

from typing import Final, Protocol

from sitl_mock.dynamics.ardupilot_control import ArduControl, ArduGains, ArduMemory
from sitl_mock.dynamics.multicopter import Airframe, Multicopter
from sitl_mock.dynamics.px4_control import Px4Control, Px4Memory
from sitl_mock.dynamics.px4_gains import Px4Gains
from sitl_mock.dynamics.rover import Rover
from sitl_mock.dynamics.shaping import Reference, TravelLimits
from sitl_mock.dynamics.values import Body, Estimate, Motion, Ned, Setpoint, Surroundings


class Vehicle(Protocol):
    """Anything the mock's core can move."""

    def reference(self, motion: Motion) -> Reference | None:
        """The motion that the control follows, where it makes one."""
        ...

    def initial(self, position_ned_m: Ned, yaw_rad: float, *, flying: bool = False) -> Motion:
        """A vehicle at rest."""
        ...

    def estimate(self, body: Body, around: Surroundings) -> Estimate:
        """What the autopilot believes and reports."""
        ...

    def step(self, motion: Motion, setpoint: Setpoint, around: Surroundings, dt_s: float) -> Motion:
        """The vehicle `dt_s` later; pure, so the same arguments give the same motion.

        Args:
            motion: As it is now.
            setpoint: What is obeyed.
            around: Wind and the ground's height.
            dt_s: The step.
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
    attitude_gain_1_s=6.0,
    rate_gain_1_s=50.0,
    lean_rate_max_rad_s=3.14,
    yaw_rate_gain_1_s=5.0,
    thrust_max_m_s2=25.0,
    rotor_lag_s=0.05,
    drag_1_s=0.325,
    drag_1_m=0.0212,
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
    gains: Px4Gains | None = None, travel: TravelLimits = PX4_TRAVEL, airframe: Airframe = PX4_AIRFRAME
) -> Multicopter[Px4Memory]:
    """The quadrotor of PX4's SIH simulator under PX4's default parameters, or with some replaced."""
    control = Px4Control(gains or Px4Gains(), travel, airframe.thrust_max_m_s2)
    return Multicopter(control, Px4Memory, airframe, setpoint_delay_s=0.01)


def arducopter_quadrotor(
    gains: ArduGains | None = None, travel: TravelLimits = ARDUCOPTER_TRAVEL, airframe: Airframe = ARDUCOPTER_AIRFRAME
) -> Multicopter[ArduMemory]:
    """The quadrotor of ArduPilot's simulator under ArduCopter's default parameters, or with some replaced."""
    control = ArduControl(gains or ArduGains(), travel, airframe.thrust_max_m_s2)
    return Multicopter(control, ArduMemory, airframe, velocity_scale_ned=(1.0, 1.0, 0.971), setpoint_delay_s=0.03)


def rover() -> Rover:
    """A skid-steered ground vehicle."""
    return Rover()
