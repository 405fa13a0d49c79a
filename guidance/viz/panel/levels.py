"""Severity of each displayed value, by the limits that the flight itself uses.

The page shows it as a colour, a shape and a word.
"""

import math
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, Final

from guidance.flight import FlightSettings, State
from guidance.flight.readiness import HEARTBEAT_LIMIT_S, TELEMETRY_LIMIT_S
from guidance.flight.table import SETPOINT_STATES
from guidance.game import Winner


class Level(StrEnum):
    """Severity."""

    OK = "ok"
    CAUTION = "caution"
    WARNING = "warning"
    UNKNOWN = "unknown"  # no value, which is no fault


BATTERY_CAUTION: Final = 0.1
"""Caution below the minimum of the battery plus this (0 to 1). The flight returns at the minimum."""

_STATES: Final[Mapping[State, Level]] = {
    State.CONNECTING: Level.CAUTION,
    State.CHECKING: Level.CAUTION,
    State.PAUSED: Level.CAUTION,
    State.HOLDING: Level.CAUTION,
    State.YIELDED: Level.WARNING,
    State.FAILED: Level.WARNING,
}


def of_state(state: State) -> Level:
    """Severity of a state: at least caution if it needs a person."""
    return _STATES.get(state, Level.OK)


def of_age(age_s: float, limit_s: float, caution_s: float | None = None) -> Level:
    """Severity of an age: warning above the flight's limit, caution above `caution_s` (default: half the limit)."""
    if math.isnan(age_s):
        return Level.UNKNOWN
    if age_s > limit_s:
        return Level.WARNING
    return Level.CAUTION if age_s > (0.5 * limit_s if caution_s is None else caution_s) else Level.OK


def of_operator(status: Mapping[str, Any]) -> dict[str, Any] | None:
    """Severity of the time since the last sign of life; None if the vehicle file requires none."""
    silence_s, limit_s = status.get("operator_silence_s"), status.get("operator_timeout_s")
    if not (isinstance(silence_s, int | float) and isinstance(limit_s, int | float)):
        return None
    return {"level": str(of_age(silence_s, limit_s)), "silence_s": silence_s, "limit_s": limit_s}


def of_battery(remaining: float, minimum: float) -> Level:
    """Severity of the remaining battery, 0 to 1."""
    if math.isnan(remaining):
        return Level.UNKNOWN
    if remaining < minimum:
        return Level.WARNING
    return Level.CAUTION if remaining < minimum + BATTERY_CAUTION else Level.OK


def of_winner(winner: int | None, *, no_game: bool) -> Level:
    """Severity of the winner: warning if the evader wins or is too fast."""
    if winner is None:
        return Level.UNKNOWN
    return Level.OK if winner == Winner.PURSUER and not no_game else Level.WARNING


def of_snapshot(snapshot: Mapping[str, Any], settings: FlightSettings) -> dict[str, str]:
    """Severities of a snapshot. Its unknown values are NaN."""
    state, ages, game = State(snapshot["state"]), snapshot["age_s"], snapshot["game"]
    levels = {
        "state": of_state(state),
        "heartbeat": of_age(ages["heartbeat"], HEARTBEAT_LIMIT_S),
        "position": of_age(ages["position"], TELEMETRY_LIMIT_S, 0.3),
        "evader": of_age(ages["evader"], settings.cycle.evader_timeout_s),
        "battery": of_battery(snapshot["battery"], settings.battery_minimum),
        "stream": Level.WARNING if state in SETPOINT_STATES and not snapshot["streaming"] else Level.OK,
        "winner": of_winner(None if game is None else game["winner"], no_game=game is not None and game["no_game"]),
        "limits": Level.CAUTION if game is not None and game["limits"] else Level.OK,
    }
    return {name: str(level) for name, level in levels.items()}
