"""PREFLIGHT_CALIBRATION: answers and texts of PX4 v1.17 (SIH) for each kind of calibration.

Calibrations of the accelerometer and the compass never end, because the vehicle is not turned. That of the simulated
barometer never ends and cannot be cancelled.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain, count
from types import MappingProxyType
from typing import Final

from sitl_mock.protocols import Command, CommandAnswer, Result
from sitl_mock.protocols.command import Answers
from sitl_mock.vehicle.state import Severity, VehicleState

Line = tuple[float, Severity, str]

_INFO = Severity.INFO
_CRITICAL = Severity.CRITICAL
_STEP_S: Final = 0.1
_PENDING: Final = "pending: back front left right up"
_SIDE_S: Final = 3.75
"""Interval at which a side that is done already is detected again."""


def _progress(kind: str, steps: tuple[int, ...], done_s: float) -> tuple[Line, ...]:
    reported = tuple(
        (0.05 + _STEP_S * number, _INFO, f"progress <{share}>")
        for number, share in enumerate(steps)
    )
    return (*reported, (done_s, _INFO, f"calibration done: {kind}"))


_STILL: Final = (
    (0.1, _INFO, _PENDING + " down"),
    (0.15, _INFO, "hold vehicle still on a pending side"),
)
_DOWN: Final = "down orientation detected"
_ACCELEROMETER: Final = (
    *_STILL,
    (2.5, _INFO, "detected rest position, hold still..."),
    (3.85, _INFO, _DOWN),
    (3.9, _INFO, _DOWN),
    (3.95, _INFO, "Hold still, measuring down side"),
    (7.1, _INFO, "down side result: [-0.028 -0.042 -9.811]"),
    (7.1, _INFO, "progress <17>"),
    (7.15, _INFO, "down side done, rotate to a different side"),
    (7.2, _INFO, "down side done, rotate to a different side"),
    (7.4, _INFO, _PENDING),
    (7.4, _INFO, "hold vehicle still on a pending side"),
)
_AGAIN: Final = (
    (9.7, _INFO, "detected rest position, hold still..."),
    (11.05, _INFO, "down side already completed"),
    (11.1, _INFO, _PENDING),
    (11.15, _INFO, "hold vehicle still on a pending side"),
)
_COMPASS: Final = (
    *_STILL,
    (1.9, _INFO, "detected rest position, hold still..."),
    (2.4, _INFO, _DOWN),
    (2.5, _INFO, _DOWN),
    (2.55, _INFO, "Rotate vehicle"),
)
_SCRIPTS: Final = MappingProxyType(
    {
        "gyro": _progress("gyro", (*range(0, 101, 10),), 1.1),
        "level": _progress("level", (*range(0, 101, 20), 100), 0.65),
        "accel": _ACCELEROMETER,
        "mag": _COMPASS,
        "airspeed": ((0.05, _CRITICAL, "Ensure sensor is not measuring wind"),),
        "baro": (),
    }
)
_THERMAL = "thermal"
_RADIO = "radio"
_QUIET = "quiet"
_ESC = "ESC"
_KINDS: Final = MappingProxyType(
    {
        (0, 1): "gyro",
        **dict.fromkeys(((0, 3), (4, 3), (6, 3)), _THERMAL),
        (1, 1): "mag",
        (2, 1): "baro",
        (3, 1): _RADIO,
        (3, 2): _QUIET,
        (4, 1): "accel",
        (4, 2): "level",
        (4, 4): _QUIET,
        **dict.fromkeys(((5, 1), (5, 2)), "airspeed"),
        (6, 1): _ESC,
        (3, 0): _QUIET,
    }
)
"""Kind of calibration by (parameter index, value); the first match counts. PX4 reads NaN as no value."""
_GYRO_ID: Final = "CAL_GYRO0_ID"
_CANCELLED: Final = (
    CommandAnswer(Result.ACCEPTED),
    CommandAnswer(Result.TEMPORARILY_REJECTED, delay_s=0.01),
)


def _answer(result: Result) -> Answers:
    return (CommandAnswer(result),)


@dataclass(slots=True)
class Calibration:
    """The running calibration, if any.

    Attributes:
        kind: gyro, mag, baro, accel, level or airspeed; empty if none runs.
    """

    kind: str = ""
    _begun_s: float = 0.0
    _next: Line | None = None
    _script: Iterator[Line] = field(default_factory=lambda: iter(()))

    def execute(self, state: VehicleState, now_s: float, command: Command) -> Answers:
        """Begin, cancel or refuse a calibration."""
        numbers = [int(value) if math.isfinite(value) else None for value in command.params]
        if state.armed:
            return _answer(Result.TEMPORARILY_REJECTED)
        if numbers == [0] * 7:
            if not self.kind:
                return _answer(Result.ACCEPTED)
            if self.kind not in {"accel", "mag", "airspeed"}:
                return _answer(Result.TEMPORARILY_REJECTED)
            state.say(_CRITICAL, "[cal] calibration cancelled")
            self.kind = ""
            return _CANCELLED
        if self.kind:
            return _answer(Result.TEMPORARILY_REJECTED)
        return self._begin(
            state, now_s, next((_KINDS[at] for at in _KINDS if numbers[at[0]] == at[1]), "")
        )

    def _begin(self, state: VehicleState, now_s: float, kind: str) -> Answers:
        if kind in _SCRIPTS:
            self.kind = kind
            self._begun_s = now_s
            again = (
                (at_s + number * _SIDE_S, level, text)
                for number in count()
                for at_s, level, text in _AGAIN
            )
            self._script = chain(_SCRIPTS[kind], again if kind == "accel" else ())
            self._next = next(self._script, None)
            state.say(_INFO, f"[cal] calibration started: 2 {kind}")
            return _answer(Result.ACCEPTED)
        if kind == _ESC:
            state.say(_CRITICAL, "[cal] calibration failed: Disconnect battery and try again")
            return _answer(Result.DENIED)
        if kind == _THERMAL:
            return ()
        if kind == _RADIO:
            state.say(_INFO, "Calibration: Disabling RC input")
        return _answer(Result.ACCEPTED if kind else Result.UNSUPPORTED)

    def advance(self, state: VehicleState, now_s: float) -> None:
        """Send the texts that are due."""
        while self.kind and self._next is not None and now_s >= self._begun_s + self._next[0]:
            _, level, text = self._next
            state.say(level, f"[cal] {text}")
            self._next = next(self._script, None)
            if text.startswith("calibration done"):
                if self.kind == "gyro":
                    # The gyro is named as calibrated, as it is by default.
                    state.parameters.set(_GYRO_ID, state.parameters.default_of(_GYRO_ID))
                    state.parameter_news.append(_GYRO_ID)
                self.kind = ""
