"""One state of a game solved, and its answer laid out: for people as a table, for programs as JSON."""

import json
import math
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from guidance.game import Game, Reason, Solution, Winner, solve
from guidance.screen import console, pairs


def solve_state(game: Game, places_m: Sequence[tuple[float, ...]], *, as_json: bool) -> None:
    """Solve one state and print the answer.

    Args:
        game: What is played.
        places_m: Of pursuer, evader and, in TAD, target: x, y, z, m.
        as_json: Print one JSON object.
    """
    answer = solve(game, *(np.asarray(place) for place in places_m))
    if as_json:
        sys.stdout.write(json.dumps(as_record(answer)) + "\n")
    else:
        console().print(_grid(answer, with_target=len(places_m) > 2))


def as_record(answer: Solution) -> dict[str, Any]:
    """Return a single answer as plain values; what is infinite or NaN becomes null, which JSON can say."""
    record: dict[str, Any] = {}
    for name, field in answer._asdict().items():
        values = [float(part) if math.isfinite(part) else None for part in np.ravel(field)]
        record[name] = values if np.ndim(field) else values[0]
    return record | {"winner": Winner(int(answer.winner)).word, "reason": Reason(int(answer.reason)).word}


def _grid(answer: Solution, *, with_target: bool) -> Table:
    """Lay an answer out for people."""
    escapes = int(answer.winner) < 0
    meaning = ("pursuer short of a capture by" if escapes else "final distance to the target") + ", m"
    rows = [
        ("winner", Winner(int(answer.winner)).word),
        (meaning if with_target else "time to capture, s", f"{float(answer.value):.4f}"),
        ("margin, s", f"{float(answer.margin_s):.4f}" if with_target else "none: without a target it always captures"),
        ("meeting point, m", _vector(answer.meeting_point_m)),
        ("meeting time, s", f"{float(answer.meeting_time_s):.4f}"),
        ("pursuer's velocity, m/s", _vector(answer.pursuer_velocity_m_s)),
        ("evader's velocity, m/s", _vector(answer.evader_velocity_m_s)),
        ("reason", Reason(int(answer.reason)).word.replace("_", " ")),
    ]
    return pairs(rows)


def _vector(vector: Any) -> str:  # noqa: ANN401 - an array of any library
    return ", ".join(f"{float(part):.4f}" for part in vector)
