"""Promises of a flight compared with its record: columns that complete the outcome row."""

import math
from pathlib import Path
from typing import Any

from guidance.cycle import Alarm, Violation
from guidance.flight import State
from guidance.game import Winner
from guidance.log import CycleEntry, cycles_of
from guidance.messages import LocalPosition


def promises(record: Path, *, speed_m_s: float, limit_m_s: float) -> dict[str, Any]:
    """Compare the promises in a record with the flight.

    Columns:
        reported: The report that the vehicle is too slow, or None.
        kept: Time flown over time promised, since that report; without a report, since engagement.
        later: Number of alarms "time of capture has risen" in that time.
        vehicle_winner: Last verdict for the vehicle before the end of the game.
        reached: Largest horizontal speed in the game over the game's speed.
        overspeed: Largest horizontal speed in the game over `limits.speed_m_s`.

    Args:
        record: The file.
        speed_m_s: Speed of the pursuer in the game.
        limit_m_s: `limits.speed_m_s` of the flight.
    """
    played = [cycle for cycle in cycles_of(record) if cycle.state in {State.ENGAGED, State.PAUSED}]
    told = [number for number, cycle in enumerate(played) if _alarm(cycle, Violation.TOO_SLOW)]
    since = played[told[0] + 1 :] if told else played
    promised_s = next((c.certificate.time_needed_s for c in since if c.certificate), math.nan)
    verdicts = [
        c.certificate.vehicle_winner for c in played if c.certificate and not c.certificate.captured
    ]
    alarm = played[told[0]].alarm if told else None
    largest_m_s = max(_ground_speeds(played), default=math.nan)
    return {
        "reported": None if alarm is None else alarm.by,
        "kept": (played[-1].now_s - since[0].now_s) / promised_s if since else math.nan,
        "later": sum(_alarm(cycle, Violation.CAPTURE_LATER) is not None for cycle in since),
        "vehicle_winner": Winner(verdicts[-1] or 0).word if verdicts else None,
        "reached": largest_m_s / speed_m_s,
        "overspeed": largest_m_s / limit_m_s,
    }


def farthest_m(record: Path) -> float:
    """Return the largest horizontal distance from the first position of a flight until its game was over, m."""
    positions = list[tuple[float, float]]()
    for cycle in cycles_of(record):
        if cycle.state in {State.RETURNING, State.LANDING}:
            break
        positions += [
            message.position_ned_m[:2]
            for message in cycle.inputs.messages
            if isinstance(message, LocalPosition)
        ]
    return max(math.dist(position_m, positions[0]) for position_m in positions)


def _alarm(cycle: CycleEntry, violation: Violation) -> Alarm | None:
    return cycle.alarm if cycle.alarm is not None and cycle.alarm.violation is violation else None


def _ground_speeds(played: list[CycleEntry]) -> list[float]:
    messages = (message for cycle in played for message in cycle.inputs.messages)
    return [
        math.hypot(*one.velocity_ned_m_s[:2]) for one in messages if isinstance(one, LocalPosition)
    ]
