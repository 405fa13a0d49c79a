"""Parameters of PX4's multicopter position and yaw control, with PX4's names and defaults."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Px4Gains:
    """Parameters of the control law; the PX4 parameter is named where there is one."""

    xy_p_1_s: float = 0.95  # MPC_XY_P
    z_p_1_s: float = 1.0  # MPC_Z_P
    xy_vel_p_1_s: float = 1.8  # MPC_XY_VEL_P_ACC
    xy_vel_i_1_s2: float = 0.4  # MPC_XY_VEL_I_ACC
    xy_vel_d: float = 0.2  # MPC_XY_VEL_D_ACC
    z_vel_p_1_s: float = 4.0  # MPC_Z_VEL_P_ACC
    z_vel_i_1_s2: float = 2.0  # MPC_Z_VEL_I_ACC
    xy_vel_max_m_s: float = 12.0  # MPC_XY_VEL_MAX
    up_max_m_s: float = 3.0  # MPC_Z_VEL_MAX_UP
    down_max_m_s: float = 1.5  # MPC_Z_VEL_MAX_DN
    tilt_max_rad: float = math.radians(45.0)  # MPC_TILTMAX_AIR
    # MPC_TILTMAX_LND, until the end of the take-off ramp
    tilt_ground_rad: float = math.radians(12.0)
    xy_error_max_m: float = (
        2.0  # MPC_XY_ERR_MAX: position lag at which a trajectory waits for the vehicle
    )
    thrust_min: float = 0.12  # MPC_THR_MIN, of full throttle
    thrust_level_margin: float = (
        0.3  # MPC_THR_XY_MARG: share of full throttle reserved for horizontal control
    )
    # MPC_USE_HTE: time constant of the hover thrust estimate; 8 to 12 s in its own logs
    hover_lag_s: float = 10.0
    spool_s: float = 1.0  # COM_SPOOLUP_TIME
    ramp_s: float = 3.0  # MPC_TKO_RAMP_T
    take_off_wish_m_s: float = 0.1  # a climb faster than this on the ground starts the ramp
    derivative_lag_s: float = 0.032  # MPC_VELD_LP 5 Hz
    yaw_p_1_s: float = 2.8  # MC_YAW_P
    yaw_rate_p_1_s: float = 3.2  # MC_YAWRATE_P over the yaw inertia
    yaw_rate_i_1_s2: float = 1.6  # MC_YAWRATE_I is half of MC_YAWRATE_P
    yaw_damping_1_s: float = 0.8  # yaw damping; measured: the response first reaches 80 % of a rate
    yaw_rate_max_rad_s: float = math.radians(200.0)  # MC_YAWRATE_MAX
    # MPC_YAWRAUTO_MAX, in the autopilot's own modes
    yaw_auto_rate_max_rad_s: float = math.radians(60.0)
    yaw_drift_rad_s: float = math.radians(1.8)  # measured: 9 degrees in 5 s with yaw ignored
