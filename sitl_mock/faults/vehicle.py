"""Flight faults (pilot, radio, estimator, battery, fence, wind), applied as conditions of the vehicle."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.faults import frames
from sitl_mock.faults.effect import (
    Direction,
    Effect,
    EffectInputs,
    FaultKind,
    Group,
    Scope,
)
from sitl_mock.faults.links import changing
from sitl_mock.faults.other_senders import mode_named
from sitl_mock.faults.places import along, vector
from sitl_mock.tables import REQUIRED, Option, number, text
from sitl_mock.vehicle.conditions import CONDITIONS
from sitl_mock.vehicle.pilot import Sticks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

_STICK: Final = Option("from -1 to 1", 0.0, number(-1.0, 1.0))
_WIND: Final = Option("m/s", 0.0, number(-40.0, 40.0))
_JUMP: Final = Option("metres", 0.0, number(-1e4, 1e4))
_DRIFT: Final = Option("metres a second", 0.0, number(-5.0, 5.0))


def _while(inputs: EffectInputs, condition: str, value: Any) -> Effect:  # noqa: ANN401 - a condition's value
    """Hold a condition from begin to end."""
    vehicle = inputs.vehicle
    return Effect(
        begin=lambda _now_s: vehicle.inject(condition, value),
        end=lambda _now_s: vehicle.inject(condition, CONDITIONS[condition].rest),
    )


def _once(inputs: EffectInputs, condition: str, value: Any) -> Effect:  # noqa: ANN401 - a condition's value
    """Apply an event once."""
    return Effect(begin=lambda _now_s: inputs.vehicle.inject(condition, value))


def _radio(inputs: EffectInputs, effect: Effect) -> Effect:
    """Give the vehicle a radio from the start, because its pilot needs one."""
    vehicle = inputs.vehicle

    def prepare(now_s: float) -> None:
        vehicle.inject("rc", value=True)
        if not vehicle.autopilot.state.pilot.known:
            vehicle.autopilot.state.pilot.hear(now_s, Sticks())

    effect.prepare = prepare
    return effect


def _eph(inputs: EffectInputs) -> Effect:
    vehicle = inputs.vehicle
    options = inputs.options
    since_s = [math.inf]

    def begin(now_s: float) -> None:
        since_s[0] = now_s

    def advance(now_s: float) -> Iterable[tuple[str, bytes]]:
        vehicle.inject("eph_m", min(options["most_m"], options["rate_m_s"] * (now_s - since_s[0])))
        return ()

    return Effect(begin=begin, advance=advance, end=lambda _now_s: vehicle.inject("eph_m", 0.0))


def _truncation(inputs: EffectInputs) -> Effect:
    options = inputs.options

    def reduced(_now_s: float, frame: bytes) -> dict[str, float]:
        north, east, down = (frames.value(frame, name) for name in ("vx", "vy", "vz"))
        speed_m_s = math.hypot(north, east)
        scale = min(1.0, options["horizontal_m_s"] / speed_m_s) if speed_m_s > 0.0 else 1.0
        return {
            "vx": north * scale,
            "vy": east * scale,
            "vz": min(max(down, -options["up_m_s"]), options["down_m_s"])
            if math.isfinite(down)
            else down,
        }

    return Effect(alter=changing(inputs, reduced))


def _flight(meaning: str, condition: str, value: Any = True, for_s: float = math.inf) -> FaultKind:  # noqa: ANN401 - as above
    return FaultKind(
        Group.FLIGHT, meaning, lambda inputs: _while(inputs, condition, value), for_s=for_s
    )


def _valued(
    meaning: str,
    condition: str,
    options: Mapping[str, Option],
    value: Callable[[EffectInputs], Any],
    *,
    for_s: float = math.inf,
) -> FaultKind:
    """Return a maker of effects that set a condition from the options; with a duration of 0 it is an event."""
    put = _while if for_s else _once
    return FaultKind(
        Group.FLIGHT,
        meaning,
        lambda inputs: put(inputs, condition, value(inputs)),
        options,
        for_s=for_s,
    )


def _option(name: str) -> Callable[[EffectInputs], Any]:
    return lambda inputs: inputs.options[name]


def _charge(meaning: str, share: float) -> FaultKind:
    options = {"share": Option("charge left, a fraction", share, number(0.0, 1.0))}
    return _valued(meaning, "battery", options, _option("share"), for_s=0.0)


FLIGHT_KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {
        "telemetry_freeze": _flight("only HEARTBEAT and answers are sent", "telemetry_frozen"),
        "silence": _flight("nothing is sent", "silent"),
        "pilot_mode": FaultKind(
            Group.FLIGHT,
            "the pilot switches to a mode; there is a radio from the start",
            lambda inputs: _radio(
                inputs,
                _once(inputs, "pilot_mode", mode_named(inputs.vehicle, inputs.options["mode"])),
            ),
            {"mode": Option("its name", REQUIRED, text)},
            for_s=0.0,
        ),
        "pilot_sticks": FaultKind(
            Group.FLIGHT,
            "the pilot moves the sticks; there is a radio from the start",
            lambda inputs: _radio(
                inputs,
                _while(inputs, "sticks", tuple(inputs.options[name] for name in Sticks._fields)),
            ),
            {"roll": _STICK, "pitch": _STICK, "throttle": _STICK, "yaw": _STICK},
            for_s=1.0,
        ),
        "rc_loss": FaultKind(
            Group.FLIGHT,
            "the radio, present from the start, is lost",
            lambda inputs: _radio(
                inputs,
                Effect(
                    begin=lambda _now_s: inputs.vehicle.inject("rc", value=False),
                    end=lambda _now_s: inputs.vehicle.inject("rc", value=True),
                ),
            ),
        ),
        "gcs_loss": _flight("ground stations are not heard", "gcs_lost"),
        "arm_refused": _valued(
            "arming is refused with a text",
            "arm_refused",
            {"text": Option("the reason", "Preflight Fail: Compass Sensor 0 missing", text)},
            _option("text"),
        ),
        "offboard_refused": _flight("OFFBOARD or GUIDED is refused and ended", "offboard_refused"),
        "ekf_jump": _valued(
            "the position estimate jumps, the reset counter rises",
            "ekf_jump_m",
            along(_JUMP),
            vector,
            for_s=0.0,
        ),
        "ekf_yaw_jump": _valued(
            "the heading estimate jumps, the reset counter rises",
            "ekf_yaw_jump_deg",
            {"by_deg": Option("degrees, clockwise", 30.0, number(-180.0, 180.0))},
            _option("by_deg"),
            for_s=0.0,
        ),
        "gps_loss": _flight("no GPS fix; the estimate drifts and becomes invalid", "gps_lost"),
        "gps_drift": _valued(
            "the position estimate drifts; velocities stay correct",
            "drift_m_s",
            along(_DRIFT),
            vector,
            for_s=10.0,
        ),
        "barometer_drift": _valued(
            "the height estimate drifts",
            "drift_m_s",
            {"down_m_s": Option("metres a second, downwards", 0.2, number(-5.0, 5.0))},
            lambda inputs: (0.0, 0.0, inputs.options["down_m_s"]),
            for_s=10.0,
        ),
        "thrust_loss": _valued(
            "the rotors produce less thrust than demanded",
            "thrust_share",
            {"share": Option("of the thrust that is left", 0.8, number(0.0, 1.0))},
            _option("share"),
        ),
        "estimator_invalid": _flight("position and velocity are invalid", "estimator_invalid"),
        "eph_growth": FaultKind(
            Group.FLIGHT,
            "the horizontal uncertainty grows",
            _eph,
            {
                "rate_m_s": Option("metres a second", 1.0, number(0.0, 1e3)),
                "most_m": Option("up to so many metres", 100.0, number(0.0, 1e4)),
            },
        ),
        "fence_breach": _flight("the fence counts as breached", "fence_breach"),
        "battery_low": _charge("the battery is low", 0.12),
        "battery_critical": _charge("the battery is critical", 0.06),
        "wind_gust": _valued(
            "a steady wind for a while", "wind_m_s", along(_WIND), vector, for_s=3.0
        ),
        "gusts": _valued(
            "random gusts of wind",
            "gust_m_s",
            {"sd_m_s": Option("standard deviation, m/s", 3.0, number(0.0, 30.0))},
            _option("sd_m_s"),
        ),
        "push": _valued(
            "the vehicle's velocity jumps", "push_m_s", along(_WIND), vector, for_s=0.0
        ),
        "velocity_truncation": FaultKind(
            Group.FLIGHT,
            "velocity setpoints are reduced",
            _truncation,
            {
                "horizontal_m_s": Option("limit", 2.0, number(0.0, 1e3)),
                "up_m_s": Option("limit", 1.0, number(0.0, 1e3)),
                "down_m_s": Option("limit", 1.0, number(0.0, 1e3)),
            },
            Scope(Direction.IN, ("SET_POSITION_TARGET_LOCAL_NED",)),
        ),
        "reboot": FaultKind(
            Group.FLIGHT,
            "the autopilot restarts, also in flight; its clock restarts",
            lambda inputs: _once(inputs, "reboot", value=True),
            for_s=0.0,
        ),
    }
)
