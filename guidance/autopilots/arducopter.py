"""ArduCopter: its modes and streams, how its vehicle handles, and its parameters; and ArduRover's modes.

Sources: ArduCopter's `mode.h`, MAVLink common, its parameter list, and our own measurements of ArduCopter 4.5.7 (its
simulated quadrotor, default parameters).
"""

import math
from dataclasses import replace
from typing import Final

from guidance.autopilots import description, rules
from guidance.autopilots.description import Autopilot, Bound, Mode, Version
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
from guidance.frames import LocalFrame, Projection, wrap_deg

# LOCATION_SCALING_FACTOR, metres per 1e-7 degree
_RADIUS_M: Final = 0.011131884502145034e7 * 180.0 / math.pi


def _to_metres(zero: LocalFrame, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """See `guidance.frames.Projection`."""
    east = math.radians(wrap_deg(longitude_deg - zero.longitude_deg))
    midway = math.cos(math.radians(0.5 * (latitude_deg + zero.latitude_deg)))
    return _RADIUS_M * math.radians(latitude_deg - zero.latitude_deg), _RADIUS_M * east * midway


def _to_degrees(zero: LocalFrame, north_m: float, east_m: float) -> tuple[float, float]:
    """See `guidance.frames.Projection`."""
    latitude = zero.latitude_deg + math.degrees(north_m / _RADIUS_M)
    midway = math.cos(math.radians(0.5 * (latitude + zero.latitude_deg)))
    return latitude, zero.longitude_deg + math.degrees(east_m / (_RADIUS_M * midway))


_PROJECTION: Final = Projection(_to_metres, _to_degrees)
"""ArduPilot's map: equal steps of latitude and longitude, scaled at the mean latitude (`get_distance_NE`)."""

_HANDLING: Final = Handling(
    # WPNAV_ACCEL 2.5 m/s² bounds ArduCopter's own correction, ANGLE_MAX 30° the sum at 5.7 m/s², PSC_JERK_XY 5 m/s³
    # both. Its velocity is within 1 % of the setpoint, so the servo learns nothing. WPNAV_ACCEL_Z is 1 m/s².
    # Beside drag it gathers speed with some 3.5 m/s²: a reference that runs ahead of it costs a second at the end.
    # ArduCopter flies faster than commanded until it has made up for its lag behind the reference. With more jerk
    # than its own the lag grows, and it flew 7 % over the speed limit.
    servo=ServoGains(acceleration_m_s2=4.0, vertical_acceleration_m_s2=1.5, jerk_m_s3=5.0),
    approach=Approach(braking_m_s2=2.5, vertical_braking_m_s2=0.9, lag_s=0.15, settle_s=0.2),
    acceleration=Acceleration(ground_m_s2=2.5, vertical_m_s2=1.0, descent_share=0.95),
    dynamics=Dynamics(
        acceleration_m_s2=5.0,
        vertical_acceleration_m_s2=2.0,
        jerk_m_s3=20.0,
        braking_m_s2=2.3,
        vertical_braking_m_s2=0.8,
        reaction_s=0.4,
        easing_m_s3=3.0,  # its velocity loop follows a moving position target, which recovers a late start
    ),
)

_FENCE_ACTIONS: Final = dict(
    enumerate(("report only", "RTL or Land", "Land", "SmartRTL", "Brake", "SmartRTL or Land"))
)
_FENCE_TYPES: Final = {0: "height", 1: "circle", 2: "polygon", 3: "floor"}
_HEIGHT: Final = 1
_CIRCLE: Final = 2
_POLYGON: Final = 4
_FLOOR: Final = 8
"""Bits of FENCE_TYPE; with the third one an uploaded fence is in use."""

_RADIO_LOSS_ACTIONS: Final = {
    0: "none",
    1: "RTL",
    3: "Land",
    4: "SmartRTL or RTL",
    5: "SmartRTL or Land",
    6: "mission's landing or RTL",
    7: "Brake or Land",
}
_ESTIMATOR_ACTIONS: Final = {0: "none", 1: "Land", 2: "AltHold", 3: "Land always"}
_OPTION_NAMES: Final = {
    0: "arming from the transmitter",
    2: "pilot's yaw ignored",
    3: "thrust",
    4: "position not held",
}
_BATTERY_ACTIONS: Final = {
    0: "warning",
    1: "Land",
    2: "RTL",
    3: "SmartRTL or RTL",
    4: "SmartRTL or Land",
    5: "Terminate",
    6: "mission's landing or RTL",
    7: "Brake or Land",
}
_TERMINATE: Final = 5
_CENTI: Final = 0.01


def _fence_floor(value: float, wants: Wants, quantities: Quantities) -> Judgement:
    floor_m = wants.limits.floor_m
    expected = f"at most limits.floor_m = {floor_m:g} m, where FENCE_TYPE has a floor"
    in_use = bool(round(quantities.get(Quantity.FENCE_TYPE, _FLOOR)) & _FLOOR)
    return passes(
        value <= floor_m or not in_use,
        expected,
        math.floor(floor_m - 1.0),
        "it would act inside ours",
        otherwise=rules.fence_verdict(wants),
    )


def _battery(value: float, _: Wants, __: Quantities) -> Judgement:
    action = round(value)
    expected = "2 (RTL), or another that returns or lands"
    if action == _TERMINATE:
        return Judgement(Verdict.REFUSE, expected, 2, "Terminate lets the vehicle fall")
    returns = action in _BATTERY_ACTIONS and action > 0
    consequence = "only our own limit returns; it does not when we are silent"
    return passes(returns, expected, 2, consequence, otherwise=Verdict.WARN)


def _critical_battery(value: float, _: Wants, __: Quantities) -> Judgement:
    terminates = round(value) == _TERMINATE
    return passes(not terminates, "any but 5 (Terminate)", 1, "Terminate lets the vehicle fall")


def _fence_type(value: float, wants: Wants, quantities: Quantities) -> Judgement:
    advice = "a height and a circle (or an uploaded polygon) are to stand behind ours"
    mask = round(value)
    horizontal = bool(mask & _CIRCLE)
    if mask & _POLYGON and quantities.get(Quantity.UPLOADED_INCLUSION) == 1.0:
        horizontal = True
    encloses = bool(mask & _HEIGHT) and horizontal
    return passes(
        encloses,
        "with height and circle",
        mask | _HEIGHT | _CIRCLE,
        advice,
        otherwise=rules.fence_verdict(wants),
    )


def _fence_radius(value: float, wants: Wants, quantities: Quantities) -> Judgement:
    if not round(quantities.get(Quantity.FENCE_TYPE, _CIRCLE)) & _CIRCLE:
        return Judgement(Verdict.PASS, "any: FENCE_TYPE is without the circle")
    return rules.fence_size("reach_m")(value, wants, quantities)


def _not_enforced(quantity: str) -> rules.Judge:
    # Measured: WPNAV_SPEED 500 still gave 15.2 m/s, and D ±10 gave ±9.7 despite 250/150.
    expected = (
        "any; the game asks {:g} m/s (not enforced on GUIDED velocities: only our own limits are)"
    )
    return lambda _, wants, __: Judgement(
        Verdict.PASS, expected.format(getattr(wants.game_speeds, quantity))
    )


def _lean(value: float, wants: Wants, _: Quantities) -> Judgement:
    advice = f"too flat to fly {wants.game_speeds.speed_m_s:g} m/s against drag"
    return passes(value >= 20.0, "at least 20°", 30.0, advice, otherwise=Verdict.WARN)


_OPTIONS: Final = rules.mask(
    "without bits 4 and 5",
    "velocities would not be held: the servo expects ArduCopter's own loop",
    clear_bits=48,
    otherwise=Verdict.REFUSE,
)
_FENCE_ACTION: Final = rules.one_of(
    range(1, 6), "1 (RTL or Land), 2 or 4 (Brake)", 1, "the fence would only report"
)
_RADIO_LOSS: Final = rules.one_of(
    {1, 3, 4, 5, 6, 7}, "1 (RTL)", 1, "nothing happens on radio loss", otherwise=Verdict.WARN
)
_ESTIMATOR: Final = rules.one_of(
    {1, 2, 3}, "1 (Land)", 1, "nothing happens when the estimator fails", otherwise=Verdict.WARN
)

_TRAFFIC: Final = rules.one_of(
    {0},
    "0 (off)",
    0,
    "ArduPilot would avoid the evader that vehicle.announce shows as traffic",
    otherwise=Verdict.REFUSE,
)

_METRES: Final = "{:g} m".format


def _rules(*navigation: Rule) -> tuple[Rule, ...]:
    """Return the rules of a version: those that all versions share, then those whose parameters were renamed."""
    return (*_SHARED, *navigation)


_SHARED: Final = (
    Rule(Quantity.LOSS_TIME, "GUID_TIMEOUT", rules.loss_time(" (3 s by default)"), "{:g} s".format),
    Rule(Quantity.GUIDED_OPTIONS, "GUID_OPTIONS", _OPTIONS, bits(_OPTION_NAMES)),
    Rule(
        Quantity.FENCE_ENABLED,
        "FENCE_ENABLE",
        rules.one_of({1}, "1 (on)", 1, "the autopilot's fence is off"),
        named({0: "off", 1: "on"}),
    ),
    Rule(Quantity.FENCE_ACTION, "FENCE_ACTION", _FENCE_ACTION, named(_FENCE_ACTIONS)),
    Rule(Quantity.FENCE_TYPE, "FENCE_TYPE", _fence_type, bits(_FENCE_TYPES)),
    Rule(Quantity.FENCE_RADIUS, "FENCE_RADIUS", _fence_radius, _METRES),
    Rule(Quantity.FENCE_HEIGHT, "FENCE_ALT_MAX", rules.fence_size("ceiling_m"), _METRES),
    Rule(Quantity.FENCE_FLOOR, "FENCE_ALT_MIN", _fence_floor, _METRES),
    # ArduPilot hides both while BATT_MONITOR is 0.
    Rule(
        Quantity.BATTERY_ACTION,
        "BATT_FS_LOW_ACT",
        _battery,
        named(_BATTERY_ACTIONS),
        needed=False,
    ),
    Rule(
        Quantity.CRITICAL_BATTERY_ACTION,
        "BATT_FS_CRT_ACT",
        _critical_battery,
        named(_BATTERY_ACTIONS),
        needed=False,
    ),
    Rule(Quantity.RADIO_LOSS_ACTION, "FS_THR_ENABLE", _RADIO_LOSS, named(_RADIO_LOSS_ACTIONS)),
    Rule(Quantity.ESTIMATOR_ACTION, "FS_EKF_ACTION", _ESTIMATOR, named(_ESTIMATOR_ACTIONS)),
    Rule(
        Quantity.TRAFFIC_ACTION,
        "AVD_ENABLE",
        _TRAFFIC,
        named({0: "off", 1: "on"}),
        of_announced=True,
    ),
)

_RETURN: Final = rules.return_height("FENCE_ALT_MAX", "RTL")
_SPEED: Final = _not_enforced("speed_m_s")
_CLIMB: Final = _not_enforced("climb_m_s")
_DESCENT: Final = _not_enforced("descent_m_s")
_CM_S: Final = "{:g} cm/s".format
_M_S: Final = "{:g} m/s".format

_RULES_4_5: Final = _rules(
    Rule(Quantity.RETURN_HEIGHT, "RTL_ALT", _RETURN, "{:g} cm".format, _CENTI),
    Rule(Quantity.SPEED, "WPNAV_SPEED", _SPEED, _CM_S, _CENTI, needed=False),
    Rule(Quantity.CLIMB, "WPNAV_SPEED_UP", _CLIMB, _CM_S, _CENTI, needed=False),
    Rule(Quantity.DESCENT, "WPNAV_SPEED_DN", _DESCENT, _CM_S, _CENTI, needed=False),
    Rule(Quantity.LEAN, "ANGLE_MAX", _lean, "{:g} cdeg".format, _CENTI),
)
_RULES_4_7: Final = _rules(
    Rule(Quantity.RETURN_HEIGHT, "RTL_ALT_M", _RETURN, _METRES),
    Rule(Quantity.SPEED, "WP_SPD", _SPEED, _M_S, needed=False),
    Rule(Quantity.CLIMB, "WP_SPD_UP", _CLIMB, _M_S, needed=False),
    Rule(Quantity.DESCENT, "WP_SPD_DN", _DESCENT, _M_S, needed=False),
    Rule(Quantity.LEAN, "ATC_ANGLE_MAX", _lean, "{:g}°".format),
)
_FENCE_BOUNDS: Final = (
    Bound("limits", "fence_radius_m", "FENCE_RADIUS"),
    Bound("limits", "ceiling_m", "FENCE_ALT_MAX"),
)
_BOUNDS_4_5: Final = (
    Bound("game", "speed_m_s", "WPNAV_SPEED", _CENTI),
    Bound("game", "climb_m_s", "WPNAV_SPEED_UP", _CENTI),
    Bound("game", "descent_m_s", "WPNAV_SPEED_DN", _CENTI),
    *_FENCE_BOUNDS,
)
_BOUNDS_4_7: Final = (
    Bound("game", "speed_m_s", "WP_SPD"),
    Bound("game", "climb_m_s", "WP_SPD_UP"),
    Bound("game", "descent_m_s", "WP_SPD_DN"),
    *_FENCE_BOUNDS,
)

_VERSIONS: Final = (
    Version((4, 5), _RULES_4_5, _BOUNDS_4_5),
    Version((4, 6), _RULES_4_5, _BOUNDS_4_5),
    Version((4, 7), _RULES_4_7, _BOUNDS_4_7),
)
"""4.7 renames parameters of navigation and attitude, and gives them in m, m/s and degrees."""

ARDUCOPTER: Final = Autopilot(
    name="arducopter",
    autopilot_id=3,
    custom_modes={Mode.GUIDED: 4, Mode.HOLD: 17, Mode.RETURN: 6, Mode.LAND: 9},
    mode_titles={Mode.HOLD: "BRAKE", Mode.RETURN: "RTL"},
    arming_mode=Mode.GUIDED,
    projection=_PROJECTION,
    unused=0.0,
    takeoff_frame=description.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    stream_before_guided=False,
    setpoint_timeout_s=3.0,
    waits_in_guided=True,
    prearm_always_told=False,
    streams_hz=description.STREAMS_HZ,
    handling=_HANDLING,
    versions=_VERSIONS,
    uploaded_fence_counts=lambda quantities: bool(
        round(quantities.get(Quantity.FENCE_TYPE, _POLYGON)) & _POLYGON
    ),
    one_inclusion_is_enough=False,
    tells_setpoint_always=False,
    mock="arducopter",
)

ROVER: Final = replace(
    ARDUCOPTER,
    name="rover",
    custom_modes={Mode.GUIDED: 15, Mode.HOLD: 4, Mode.RETURN: 11},
    mode_titles={Mode.RETURN: "RTL"},
    streams_hz={description.LOCAL_POSITION_NED: 20.0, description.GLOBAL_POSITION_INT: 20.0},
)
"""The ground vehicle that plays the evader in mocked flights: ArduCopter's protocol, with its own modes."""
