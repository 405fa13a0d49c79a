"""Replies to operators: the status of a flight, reasons of refused orders, and advice."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from guidance.autopilots import Finding, Verdict
from guidance.flight import BEFORE_FLIGHT, ORDERS, Event, Flight, Outputs, State, is_done
from guidance.flight.observed import AGREEING_S
from guidance.flight.table import state_words
from guidance.game import Reason, Winner
from guidance.log.codec import plain
from guidance.messages import Heartbeat, Home, LocalPosition, SystemStatus
from guidance.preflight import advice, refusals
from guidance.vehicle import VehicleState

_WHY: Final[Mapping[State, str]] = {
    State.ARMING: "it is arming",
    State.CLIMBING: "it is taking off",
    State.POSITIONING: "it is on its way to the start",
    State.STANDING_BY: "it stands by: order engage, hold, land or return",
    State.ENTERING: "it is entering the guided mode",
    State.ENGAGED: "the game is on",
    State.PAUSED: "the game is paused",
    State.ON_STATION: "it is on station",
    State.OUT_OF_CONTACT: "it stands by out of contact: order hold, land or return, or wait for telemetry",
    State.HOLDING: "it holds: order engage, land or return",
    State.RETURNING: "it is returning: order hold or land",
    State.LANDING: "it is landing: order hold or return",
}

_ENDED: Final[Mapping[State, str]] = {
    State.LANDED: "the flight is over",
    State.YIELDED: "guidance has yielded and is silent ({})",
    State.FAILED: "the flight could not be flown ({})",
}
"""Description of each final state, with its cause."""

_GOES_ON: Final[Mapping[State, tuple[str, str]]] = {
    State.HOLDING: ("held", "engage, return or land"),
    State.RETURNING: ("returning", "hold or land"),
    State.LANDING: ("landing", "hold or return"),
}
"""For each state that an operator ordered: its name, and the orders that change it."""


def refusal(order: Event, flight: Flight, now_s: float, rows: Sequence[Finding]) -> str:
    """Say why `order` changed nothing.

    Args:
        order: The refused order.
        flight: The flight.
        now_s: The present.
        rows: Preflight's findings.
    """
    state = flight.state
    if flight.fault is not None:
        return (
            f"guidance failed ({flight.fault}), and is silent since: order reset to begin another"
        )
    if state in _ENDED:
        cause = "unknown cause" if flight.cause is None else flight.cause.words
        return f"{_ENDED[state].format(cause)}: order reset to begin another"
    if state in BEFORE_FLIGHT:
        return _not_begun(order, flight, missing(flight, now_s, rows))
    if order is Event.ENGAGE and state in {State.HOLDING, State.STANDING_BY}:
        doubt = flight.telemetry_refusal(now_s) or flight.evader_refusal(now_s)
        if not flight.observed.has_flown:
            doubt = "it stands on the ground: once it is disarmed, order reset, then start"
        elif flight.leaving_modes:
            modes = " and ".join(map(flight.settings.autopilot.mode_title, flight.leaving_modes))
            doubt = (
                f"HEARTBEATs of the last {AGREEING_S:g} s show it in {modes}: "
                "order again once all of them show its hold"
            )
        return doubt if doubt else f"not ready: {missing(flight, now_s, rows)}"
    return f"under way already: {_WHY[state]}" if order is Event.START else _WHY[state]


def shown_state(flight: Flight) -> str:
    """Return the state in words."""
    airborne = flight.vehicle.armed and not flight.vehicle.on_ground
    return state_words(flight.state, airborne=airborne)


def next_words(flight: Flight) -> str:
    """Return the orders that continue, if the flight waits for a person; else an empty string."""
    if flight.ordered_by_operator and flight.state in _GOES_ON:
        pause, orders = _GOES_ON[flight.state]
        return f"{pause} by operator: continue with guidance ctl {orders}"
    if flight.state is State.OUT_OF_CONTACT:
        return "it stands by again when telemetry and checks are good; guidance ctl hold, return or land work too"
    if flight.cause is not None and flight.cause.event is Event.CONTACT:
        return "telemetry was lost and is back: continue with guidance ctl engage, return or land"
    return ""


def _not_begun(order: Event, flight: Flight, lacking: str) -> str:
    """Return the reason of a refusal before take-off."""
    state = flight.state
    if state is State.CONNECTING:
        return "the vehicle is not heard: check its power, the link and system_id"
    if order in {Event.HOLD, Event.RETURN, Event.LAND}:
        return "there is no flight to end: the vehicle is not armed"
    barring = flight.barring_modes
    if state is State.CHECKING or (order is Event.START and not barring):
        return f"not ready: {lacking}"
    in_air = flight.vehicle.armed and flight.vehicle.in_air
    if order is not Event.START:
        return (
            "airborne, and not taken over yet: order start first, then engage"
            if in_air
            else "on the ground: order start first"
        )
    mode = flight.mode_title
    if flight.vehicle.armed and flight.observed.mode in barring:
        return (
            f"it flies in {mode}, which guidance does not take it from: order hold, then engage"
            if in_air
            else f"somebody else armed it, in {mode}: disarm it, then order start"
        )
    modes = " and ".join(map(flight.settings.autopilot.mode_title, barring))
    return (
        f"somebody else had it armed, in {modes}, less than {AGREEING_S:g} s before its last HEARTBEAT: "
        "order start again once its HEARTBEATs agree for that long"
    )


def _failed(flight: Flight, now_s: float) -> list[Finding]:
    return [check for check in flight.checks(now_s) if check.verdict is not Verdict.PASS]


def failed_checks(flight: Flight, now_s: float) -> str:
    """Name every failed check, with its value."""
    return ", ".join(f"{check.name} ({check.value})" for check in _failed(flight, now_s))


def missing(flight: Flight, now_s: float, rows: Sequence[Finding]) -> str:
    """Name every failed check and every refused preflight row."""
    reasons = list(filter(None, (failed_checks(flight, now_s), advice(rows))))
    if not reasons:
        return "the checks have just passed, order again"
    return "; ".join(reasons)


def to_do(flight: Flight, now_s: float, rows: Sequence[Finding]) -> list[dict[str, str]]:
    """List every failed check and every preflight row that does not pass, each with advice."""
    keys = ("name", "found", "wanted", "verdict", "advice")
    not_passed = (
        row for row in (*_failed(flight, now_s), *rows) if row.verdict is not Verdict.PASS
    )
    return [dict(zip(keys, map(str, row), strict=True)) for row in not_passed]


def foreseen(
    flight: Flight, now_s: float, rows: Sequence[Finding], barred: Sequence[str]
) -> dict[str, str]:
    """Return for every order why it would be refused now; empty if it would be accepted.

    Args:
        flight: As it stands.
        now_s: The present.
        rows: Findings of preflight.
        barred: Names of what bars the vehicle from flying.
    """
    accepted = {
        order
        for order in ORDERS
        if is_done(order, flight.state) or flight.follows(order, now_s, barred)
    }
    return {
        str(order): "" if order in accepted else refusal(order, flight, now_s, rows)
        for order in sorted(ORDERS)
    }


def status(
    flight: Flight, outputs: Outputs, rows: Sequence[Finding], barred: Sequence[str], now_s: float
) -> dict[str, Any]:
    """Return the status of a flight as plain values. NaN and infinities become null.

    Args:
        flight: As it stands.
        outputs: Of the last cycle.
        rows: Findings of preflight.
        barred: Names of what bars the vehicle from flying.
        now_s: The present.
    """
    vehicle = flight.vehicle
    settings = flight.settings
    certificate = outputs.certificate
    cause = flight.cause
    fields = {
        "state": shown_state(flight),
        "mode": flight.mode_name,
        "autopilot_mode": flight.mode_title,
        "armed": vehicle.armed,
        "engage_on": str(settings.engage_on),
        "after_capture": str(settings.after_capture),
        "streaming": outputs.setpoint is not None,
        "heartbeat_age_s": vehicle.age_s(Heartbeat, now_s),
        "position_age_s": vehicle.age_s(LocalPosition, now_s),
        "evader_silence_s": flight.tracking.silence_s(now_s),
        "battery_needed": flight.observed.battery_needed,
        "operator_silence_s": flight.operator_silence_s(now_s),
        "operator_timeout_s": settings.operator_timeout_s,
        "evader_second_source": flight.tracking.rival(now_s),
        "evader_doubts": list(flight.tracking.doubts()),
        "evader_reports_dropped": dict(flight.tracking.dropped()),
        **_motion_fields(vehicle),
        "checks_failed": [check.name for check in _failed(flight, now_s)],
        "preflight_refused": list(refusals(rows)),
        "to_do": to_do(flight, now_s, rows),
        "by": None if cause is None else str(cause.by),
        "cause": None if cause is None else cause.words,
        "next": next_words(flight),
        "refused_orders": foreseen(flight, now_s, rows, barred),
        "certificate": certificate,
    }
    # Numbers get four decimals.
    rounded: dict[str, Any] = json.loads(
        json.dumps(plain(fields)), parse_float=lambda text: round(float(text), 4)
    )
    if certificate is not None:
        game = rounded["certificate"]
        game["reason"] = None if certificate.reason is None else Reason(certificate.reason).word
        game["winner"] = Winner(certificate.winner).word
        winner = certificate.vehicle_winner
        game["vehicle_winner"] = Winner(0 if winner is None else winner).word
        range_m = math.dist(certificate.pursuer_game_m, certificate.evader_game_m)
        rounded["range_m"] = round(range_m, 2)
        rounded["value_unit"] = _value_unit(flight)
    return rounded


def _value_unit(flight: Flight) -> str:
    return "m" if flight.settings.cycle.target_game_m else "s"


def _motion_fields(vehicle: VehicleState) -> dict[str, Any]:
    """Position and velocity (NED, m and m/s), height above home (m) and battery."""
    local = vehicle.latest.get(LocalPosition)
    home = vehicle.latest.get(Home)
    status = vehicle.latest.get(SystemStatus)
    if local is None:
        return {}
    height_m = -local.position_ned_m[2] + (0.0 if home is None else home.position_ned_m[2])
    return {
        "position_ned_m": [round(part, 2) for part in local.position_ned_m],
        "velocity_ned_m_s": [round(part, 2) for part in local.velocity_ned_m_s],
        "height_m": round(height_m, 2) + 0.0,
        "battery": math.nan if status is None else round(status.battery_remaining, 3),
    }


def flight_line(flight: Flight, outputs: Outputs, now_s: float) -> str:
    """Return one line about the flight for the terminal of a daemon.

    Args:
        flight: As it stands.
        outputs: Of the last cycle.
        now_s: The present.
    """
    vehicle = flight.vehicle
    certificate = outputs.certificate
    parts = [
        f"{now_s:.0f} s",
        shown_state(flight),
        f"{flight.mode_title}, {'armed' if vehicle.armed else 'disarmed'}",
    ]
    motion = _motion_fields(vehicle)
    if motion:
        north_m_s, east_m_s, _ = motion["velocity_ned_m_s"]
        height_m = round(motion["height_m"], 1) + 0.0
        parts.append(f"{height_m:.1f} m up, {math.hypot(north_m_s, east_m_s):.1f} m/s")
        battery = motion["battery"]
        if not math.isnan(battery):
            parts.append(f"battery {battery:.0%}")
        parts.append(f"position {vehicle.age_s(LocalPosition, now_s):.1f} s old")
    if certificate is not None:
        parts.append(
            f"rim {certificate.gap_m:.1f} m, value {certificate.value:.1f} {_value_unit(flight)}"
        )
    silence_s = flight.tracking.silence_s(now_s)
    parts.append("no evader" if math.isinf(silence_s) else f"evader {silence_s:.1f} s ago")
    return "  ".join(parts)
