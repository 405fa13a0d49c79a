"""How severe what is seen is: one word for each thing, by the limits that the flight itself acts on.

A page shows the word as a colour, a shape and a text; it judges nothing by itself.
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
    """How severe."""

    OK = "ok"
    CAUTION = "caution"
    WARNING = "warning"
    UNKNOWN = "unknown"  # not told; nothing is wrong with that


BATTERY_CAUTION: Final = 0.1
"""So near above the battery at which the flight returns, to be worth a look."""

_STATES: Final[Mapping[State, Level]] = {
    State.CONNECTING: Level.CAUTION,
    State.CHECKING: Level.CAUTION,
    State.PAUSED: Level.CAUTION,
    State.HOLDING: Level.CAUTION,
    State.YIELDED: Level.WARNING,
    State.FAILED: Level.WARNING,
}


def of_state(state: State) -> Level:
    """Judge a state: what needs a person is at least a caution."""
    return _STATES.get(state, Level.OK)


def of_age(age_s: float, limit_s: float, caution_s: float | None = None) -> Level:
    """Judge an age by the limit at which the flight calls it lost; by default half of that is a caution."""
    if math.isnan(age_s):
        return Level.UNKNOWN
    if age_s > limit_s:
        return Level.WARNING
    return Level.CAUTION if age_s > (0.5 * limit_s if caution_s is None else caution_s) else Level.OK


def of_operator(status: Mapping[str, Any]) -> dict[str, Any] | None:
    """Judge, of a daemon's answer, how long no person has given a sign of life; None where none is asked for."""
    silence_s, limit_s = status.get("operator_silence_s"), status.get("operator_timeout_s")
    if not (isinstance(silence_s, int | float) and isinstance(limit_s, int | float)):
        return None
    return {"level": str(of_age(silence_s, limit_s)), "silence_s": silence_s, "limit_s": limit_s}


def of_battery(remaining: float, minimum: float) -> Level:
    """Judge what is left of the battery, 0 to 1."""
    if math.isnan(remaining):
        return Level.UNKNOWN
    if remaining < minimum:
        return Level.WARNING
    return Level.CAUTION if remaining < minimum + BATTERY_CAUTION else Level.OK


def of_winner(winner: int | None, *, no_game: bool) -> Level:
    """Judge who wins: an evader that does is a warning, an evader too fast to play with as well."""
    if winner is None:
        return Level.UNKNOWN
    return Level.OK if winner == Winner.PURSUER and not no_game else Level.WARNING


def of_snapshot(seen: Mapping[str, Any], settings: FlightSettings) -> dict[str, str]:
    """Judge everything that is shown at a glance; `seen` is a snapshot with NaN where nothing is known."""
    state, ages, game = State(seen["state"]), seen["age_s"], seen["game"]
    levels = {
        "state": of_state(state),
        "heartbeat": of_age(ages["heartbeat"], HEARTBEAT_LIMIT_S),
        "position": of_age(ages["position"], TELEMETRY_LIMIT_S, 0.3),
        "evader": of_age(ages["evader"], settings.cycle.evader_timeout_s),
        "battery": of_battery(seen["battery"], settings.battery_minimum),
        "stream": Level.WARNING if state in SETPOINT_STATES and not seen["streaming"] else Level.OK,
        "winner": of_winner(None if game is None else game["winner"], no_game=game is not None and game["no_game"]),
        "limits": Level.CAUTION if game is not None and game["limits"] else Level.OK,
    }
    return {name: str(level) for name, level in levels.items()}
