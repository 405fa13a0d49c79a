"""PX4: its modes and streams, how its vehicle handles, and its parameters.

Sources: `px4_custom_mode.h`, MAVLink common, the parameter references of PX4 v1.17 and v1.18, v1.18's release
notes, and our own measurements of PX4 v1.17
(SIH quadrotor, default parameters).
"""

import math
from dataclasses import replace
from typing import Final

from guidance.autopilots import rules
from guidance.autopilots.description import (
    ATTITUDE,
    GLOBAL_POSITION_INT,
    LOCAL_POSITION_NED,
    MAV_FRAME_GLOBAL,
    ODOMETRY,
    STREAMS_HZ,
    Autopilot,
    Bound,
    Mode,
    Version,
)
from guidance.autopilots.rules import (
    Judgement,
    Quantities,
    Quantity,
    Rule,
    Verdict,
    Wants,
    bits,
    named,
    passes,
)
from guidance.control import Acceleration, Approach, Dynamics, Handling, ServoGains
from guidance.frames import LocalFrame, Projection

_RADIUS_M: Final = 6371000.0  # CONSTANTS_RADIUS_OF_EARTH


def _to_metres(zero: LocalFrame, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """See `guidance.frames.Projection`."""
    lat0 = math.radians(zero.latitude_deg)
    lat = math.radians(latitude_deg)
    east = math.radians(longitude_deg - zero.longitude_deg)
    cosine = math.sin(lat0) * math.sin(lat) + math.cos(lat0) * math.cos(lat) * math.cos(east)
    arc = math.acos(min(1.0, max(-1.0, cosine)))
    scale_m = _RADIUS_M * (arc / math.sin(arc) if arc > 1e-9 else 1.0)
    north = math.cos(lat0) * math.sin(lat) - math.sin(lat0) * math.cos(lat) * math.cos(east)
    return scale_m * north, scale_m * math.cos(lat) * math.sin(east)


def _to_degrees(zero: LocalFrame, north_m: float, east_m: float) -> tuple[float, float]:
    """See `guidance.frames.Projection`."""
    lat0 = math.radians(zero.latitude_deg)
    distance_m = math.hypot(north_m, east_m)
    if distance_m == 0.0:
        return zero.latitude_deg, zero.longitude_deg
    arc = distance_m / _RADIUS_M
    sine = math.sin(arc)
    cosine = math.cos(arc)
    lat = math.asin(cosine * math.sin(lat0) + north_m * sine * math.cos(lat0) / distance_m)
    turn = math.atan2(
        east_m * sine, distance_m * math.cos(lat0) * cosine - north_m * math.sin(lat0) * sine
    )
    return math.degrees(lat), zero.longitude_deg + math.degrees(turn)


_PROJECTION: Final = Projection(_to_metres, _to_degrees)
"""PX4's map: azimuthal equidistant on a sphere (Snyder, Map Projections, eqs. 22-4, 22-5, 25-2)."""

_HANDLING: Final = Handling(
    # PX4 shapes nothing itself. MPC_TILTMAX_AIR 45° gives 9.8 m/s²; at 6 m/s drag takes 6 m/s² of it (that airframe
    # flies no faster than 10 m/s). Most airframes have far less, so that little is assumed and the rest learned.
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
    approach=Approach(
        braking_m_s2=2.5, vertical_braking_m_s2=2.0, lag_s=0.25, vertical_settle_s=0.4, margin_m=0.1
    ),
    # Near its tilt limit it descends at 1.4 m/s instead of 1.5 m/s.
    acceleration=Acceleration(ground_m_s2=3.0, vertical_m_s2=3.0, descent_share=0.92),
    dynamics=Dynamics(
        acceleration_m_s2=9.0,
        vertical_acceleration_m_s2=3.0,
        jerk_m_s3=80.0,
        braking_m_s2=3.0,
        vertical_braking_m_s2=2.0,
        reaction_s=0.35,
        easing_m_s3=30.0,
    ),
)

_LOSS_NAMES: Final = (
    "disabled",
    "Position",
    "Altitude",
    "Stabilized",
    "Return",
    "Land",
    "Hold",
    "Terminate",
    "Disarm",
)
_LOSS_ACTIONS: Final = dict(enumerate(_LOSS_NAMES, start=-1))
_FENCE_ACTIONS: Final = {0: "none", 1: "warning", 2: "Hold", 3: "Return", 4: "Terminate", 5: "Land"}
_RADIO_LOSS_ACTIONS: Final = {
    0: "disabled",
    1: "Hold",
    2: "Return",
    3: "Land",
    5: "Terminate",
    6: "Disarm",
}
_HOLD_WITHOUT_FAILSAFE: Final = 7
_RADIO_LOSS_ACTIONS_1_18: Final = {
    **_RADIO_LOSS_ACTIONS,
    _HOLD_WITHOUT_FAILSAFE: "Hold without failsafe",
}
_BATTERY_ACTIONS: Final = {0: "warning", 2: "Land", 3: "Return, then Land"}
_TRAFFIC_ACTIONS: Final = {0: "disabled", 1: "warning", 2: "Return", 3: "Land", 4: "Hold"}
_EXCEPTIONS: Final = {
    0: "Mission",
    1: "Hold and other auto modes",
    2: "Offboard",
    3: "external modes",
}
_OVERRIDES: Final = {0: "auto modes", 1: "Offboard"}


def _loss_action(value: float, _: Wants, __: Quantities) -> Judgement:
    expected = "5 (Hold), 3 (Return) or 4 (Land)"
    action = round(value)
    reason = {
        # Measured: with a radio the pilot has it in Position; without one PX4 falls through to Return.
        0: "Position is safe with a pilot's radio; without one PX4 returns",
        1: "Altitude drifts on with the wind until a pilot acts",
        2: "Stabilized flies on until a pilot acts",
        6: "Terminate lets the vehicle fall",
        7: "Disarm lets the vehicle fall",
    }.get(action, "nothing would be done when setpoints stop")
    return passes(
        action in {3, 4, 5},
        expected,
        5,
        reason,
        otherwise=Verdict.REFUSE if action else Verdict.WARN,
    )


def _fence_action(value: float, wants: Wants, quantities: Quantities) -> Judgement:
    consequence = (
        "Terminate lets the vehicle fall"
        if round(value) == 4
        else "the autopilot's fence would not act"
    )
    return rules.one_of({2, 3, 5}, "2 (Hold), 3 (Return) or 5 (Land)", 2, consequence)(
        value, wants, quantities
    )


def _fence_distance(value: float, wants: Wants, quantities: Quantities) -> Judgement:
    uploaded = quantities.get(Quantity.UPLOADED_INCLUSION)
    if value == 0.0 and uploaded == 1.0:
        return Judgement(Verdict.PASS, "0, since the uploaded fence stands behind ours")
    read = (
        "no inclusion fence is uploaded"
        if uploaded == 0.0
        else "whether a fence is uploaded is not known"
    )
    return rules.fence_size("reach_m", f"0 disables it, and {read}")(value, wants, quantities)


def _speed(value: float, wants: Wants, _: Quantities) -> Judgement:
    enough = _at_least(value, wants.limit_speeds.speed_m_s)
    if enough.verdict is Verdict.REFUSE and value >= wants.game_speeds.speed_m_s:
        return enough._replace(
            verdict=Verdict.WARN, why="enough for the game; catching up is cut to it"
        )
    return enough


def _at_least(value: float, wanted_m_s: float) -> Judgement:
    # A parameter is single precision on the wire.
    enough = value >= wanted_m_s - 1e-4
    return passes(
        enough,
        f"at least {wanted_m_s:g} m/s",
        wanted_m_s,
        "or play with less: PX4 cuts setpoints to it",
    )


_FENCE_HEIGHT: Final = rules.fence_size(
    "ceiling_m", "0 disables it, and an uploaded fence has no height"
)
_IGNORED: Final = "radio loss is ignored in OFFBOARD: nothing happens when the pilot's link is lost"
_RADIO_EXCEPTIONS: Final = rules.mask(
    "without Offboard, where a pilot has a radio", _IGNORED, clear_bits=4
)
_NO_STICKS: Final = "the sticks do not end OFFBOARD: a pilot takes over by the mode switch"
_OVERRIDE: Final = rules.mask("with Offboard", _NO_STICKS, set_bits=2)


def _override_speed(value: float, _: Wants, __: Quantities) -> Judgement:
    expected = "a stick speed; a negative one disables it"
    return passes(value >= 0.0, expected, 1.0, _NO_STICKS, otherwise=Verdict.WARN)


def _radio_loss(value: float, wants: Wants, quantities: Quantities) -> Judgement:
    consequence = _IGNORED if round(value) == _HOLD_WITHOUT_FAILSAFE else ""
    judge = rules.one_of(
        {1, 2, 3}, "1 (Hold), 2 (Return) or 3 (Land)", 2, consequence, otherwise=Verdict.WARN
    )
    return judge(value, wants, quantities)


_SILENT: Final = "only our own limit returns; it does not when we are silent"
_BATTERY: Final = rules.one_of({2, 3}, "3 (Return, then Land)", 3, _SILENT, otherwise=Verdict.WARN)

_TRAFFIC: Final = rules.one_of(
    {0, 1},
    "0 (disabled) or 1 (warning)",
    1,
    "PX4 would avoid the evader that vehicle.announce shows as traffic",
    otherwise=Verdict.REFUSE,
)

_M_S: Final = "{:g} m/s".format

_METRES: Final = "{:g} m".format


def _rules(*changed: Rule) -> tuple[Rule, ...]:
    """Return v1.17's rules, with other ones for some quantities."""
    others = {rule.quantity: rule for rule in changed}
    return tuple(others.get(rule.quantity, rule) for rule in _RULES_1_17)


_MODE_IGNORES: Final = (
    "radio loss is ignored in external modes: nothing happens when the pilot's link is lost"
)
_NO_STICKS_IN_MODE: Final = "the sticks do not end the mode: a pilot takes over by the mode switch"

_RULES_1_17: Final = (
    Rule(Quantity.LOSS_TIME, "COM_OF_LOSS_T", rules.loss_time(), "{:g} s".format),
    Rule(Quantity.LOSS_ACTION, "COM_OBL_RC_ACT", _loss_action, named(_LOSS_ACTIONS)),
    Rule(Quantity.RADIO_LOSS_EXCEPTIONS, "COM_RCL_EXCEPT", _RADIO_EXCEPTIONS, bits(_EXCEPTIONS)),
    Rule(Quantity.STICKS_TAKE_OVER, "COM_RC_OVERRIDE", _OVERRIDE, bits(_OVERRIDES)),
    Rule(Quantity.RADIO_LOSS_ACTION, "NAV_RCL_ACT", _radio_loss, named(_RADIO_LOSS_ACTIONS)),
    Rule(Quantity.BATTERY_ACTION, "COM_LOW_BAT_ACT", _BATTERY, named(_BATTERY_ACTIONS)),
    Rule(Quantity.FENCE_ACTION, "GF_ACTION", _fence_action, named(_FENCE_ACTIONS)),
    Rule(Quantity.FENCE_RADIUS, "GF_MAX_HOR_DIST", _fence_distance, _METRES),
    Rule(Quantity.FENCE_HEIGHT, "GF_MAX_VER_DIST", _FENCE_HEIGHT, _METRES),
    Rule(
        Quantity.RETURN_HEIGHT,
        "RTL_RETURN_ALT",
        rules.return_height("GF_MAX_VER_DIST", "Return"),
        _METRES,
    ),
    Rule(Quantity.SPEED, "MPC_XY_VEL_MAX", _speed, _M_S),
    Rule(
        Quantity.CLIMB,
        "MPC_Z_VEL_MAX_UP",
        lambda value, wants, _: _at_least(value, wants.game_speeds.climb_m_s),
        _M_S,
    ),
    Rule(
        Quantity.DESCENT,
        "MPC_Z_VEL_MAX_DN",
        lambda value, wants, _: _at_least(value, wants.game_speeds.descent_m_s),
        _M_S,
    ),
    Rule(
        Quantity.TRAFFIC_ACTION,
        "NAV_TRAFF_AVOID",
        _TRAFFIC,
        named(_TRAFFIC_ACTIONS),
        of_announced=True,
    ),
)

_BOUNDS: Final = (
    Bound("game", "speed_m_s", "MPC_XY_VEL_MAX"),
    Bound("game", "climb_m_s", "MPC_Z_VEL_MAX_UP"),
    Bound("game", "descent_m_s", "MPC_Z_VEL_MAX_DN"),
    Bound("limits", "fence_radius_m", "GF_MAX_HOR_DIST"),
    Bound("limits", "ceiling_m", "GF_MAX_VER_DIST"),
)

_MODE_RULES: Final = (
    Rule(
        Quantity.RADIO_LOSS_EXCEPTIONS,
        "COM_RCL_EXCEPT",
        rules.mask(
            "without external modes, where a pilot has a radio", _MODE_IGNORES, clear_bits=8
        ),
        bits(_EXCEPTIONS),
    ),
)
"""Rules of a flight mode of ours in place of OFFBOARD's."""

_OFFBOARD_ALONE: Final = {Quantity.LOSS_TIME, Quantity.LOSS_ACTION, Quantity.STICKS_TAKE_OVER}
"""When answers stop in a mode of ours, PX4 returns, or lands if it cannot, and sticks do not end the mode: no parameter
changes either."""

_VERSIONS: Final = (
    Version((1, 17), _RULES_1_17, _BOUNDS),
    Version(
        (1, 18),
        _rules(
            Rule(
                Quantity.STICKS_TAKE_OVER,
                "MAN_OVERRIDE_SPD",
                _override_speed,
                "{:g} stick travels/s".format,
            ),
            Rule(
                Quantity.RADIO_LOSS_ACTION,
                "NAV_RCL_ACT",
                _radio_loss,
                named(_RADIO_LOSS_ACTIONS_1_18),
            ),
        ),
        _BOUNDS,
    ),
)
"""v1.18 replaces COM_RC_OVERRIDE and COM_RC_STICK_OV by MAN_OVERRIDE_SPD, and adds NAV_RCL_ACT 7."""


def _mode(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


OWN_MODE: Final = _mode(4, 255)
"""HEARTBEAT.custom_mode of the flight mode that guidance registers; PX4 itself gives it one of eight numbers."""

_CUSTOM_MODES: Final = {
    0: _mode(1),  # Manual
    1: _mode(2),  # Altitude
    2: _mode(3),  # Position
    3: _mode(4, 4),  # Mission
    4: _mode(4, 3),  # Hold
    5: _mode(4, 5),  # Return
    6: _mode(3, 2),  # Position Slow
    8: _mode(11),  # Altitude Cruise
    10: _mode(5),  # Acro
    12: _mode(4, 6),  # Descend, which MAVLink shows as Land
    13: _mode(10),  # Termination
    14: _mode(6),  # Offboard
    15: _mode(7),  # Stabilized
    17: _mode(4, 2),  # Takeoff
    18: _mode(4, 6),  # Land
    19: _mode(4, 8),  # Follow Target
    20: _mode(4, 9),  # Precision Land
    21: _mode(3, 1),  # Orbit
    22: _mode(4, 10),  # VTOL Takeoff
    **{23 + index: _mode(4, 11 + index) for index in range(8)},  # External 1 to 8
}


def custom_mode(nav_state: int) -> int:
    """Return HEARTBEAT.custom_mode of a NAVIGATION_STATE; 0 for an unknown one."""
    return _CUSTOM_MODES.get(nav_state, 0)


_OFFBOARD: Final = Autopilot(
    name="px4",
    autopilot_id=12,
    custom_modes={
        Mode.GUIDED: _mode(6),
        Mode.HOLD: _mode(4, 3),
        Mode.TAKEOFF: _mode(4, 2),
        Mode.RETURN: _mode(4, 5),
        Mode.LAND: _mode(4, 6),
    },
    mode_titles={Mode.GUIDED: "OFFBOARD"},
    arming_mode=Mode.HOLD,
    projection=_PROJECTION,
    unused=math.nan,
    takeoff_frame=MAV_FRAME_GLOBAL,
    stream_before_guided=True,
    setpoint_timeout_s=1.0,
    waits_in_guided=False,
    prearm_always_told=True,
    setpoint_modes=frozenset({_mode(6)}),
    streams_hz={**STREAMS_HZ, ODOMETRY: 10.0},
    handling=_HANDLING,
    versions=_VERSIONS,
    # Neither 0 (none) nor 1 (warning) acts.
    uploaded_fence_counts=lambda quantities: round(quantities.get(Quantity.FENCE_ACTION, 2)) > 1,
    one_inclusion_is_enough=True,
    tells_setpoint_always=True,
    mock="px4",
    mock_speeds=lambda speeds: {
        "MPC_Z_VEL_MAX_UP": speeds.climb_m_s,
        "MPC_Z_VEL_MAX_DN": speeds.descent_m_s,
    },
)

_MODE: Final = replace(
    _OFFBOARD,
    custom_modes={**_OFFBOARD.custom_modes, Mode.GUIDED: OWN_MODE},
    mode_titles={Mode.GUIDED: "the mode"},
    # Only a mode with an executor puts it in charge
    arming_mode=Mode.GUIDED,
    stream_before_guided=False,
    guided_is_ours=True,
    setpoint_modes=_OFFBOARD.setpoint_modes | {OWN_MODE},
    streams_hz={
        LOCAL_POSITION_NED: 50.0,
        ATTITUDE: 50.0,
        GLOBAL_POSITION_INT: 10.0,
    },
    versions=(
        Version(
            (1, 17),
            tuple(rule for rule in _rules(*_MODE_RULES) if rule.quantity not in _OFFBOARD_ALONE),
            _BOUNDS,
        ),
    ),
)

PX4: Final = replace(_OFFBOARD, as_mode=_MODE)
"""PX4 by OFFBOARD; `as_mode` is PX4 with a flight mode of ours."""
