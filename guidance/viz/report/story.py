"""What a record tells, as arrays over the flight's cycles, NaN where nothing was known."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from guidance.certificate import Certificate
from guidance.control import Envelope
from guidance.errors import ConfigError
from guidance.flight import FlightSettings, State
from guidance.frames import Vector
from guidance.log import (
    Aggregator,
    Cycle,
    EventEntry,
    SettingsOf,
    Survey,
    cycles_of,
    events_of,
    metadata_of,
    title_of,
)

Array = NDArray[np.float64]


class Story(NamedTuple):
    """A flight, cycle by cycle.

    `engaged` and `captured` are the cycles that say so first, None where it did not come to that; `begun_s` and
    `reached_s` are when the flight's state changed with it, by which a flight's outcome counts
    (`guidance.session.result`), NaN where it never did.
    """

    title: str
    settings: FlightSettings
    survey: Survey
    events: tuple[EventEntry, ...]
    states: tuple[str, ...]
    certificates: tuple[Certificate | None, ...]
    alarms: tuple[tuple[float, str], ...]
    home_m: Vector | None
    envelope: Envelope
    cycles: tuple[Cycle, ...]
    engaged: int | None
    captured: int | None
    begun_s: float
    reached_s: float

    def column(self, name: str) -> Array:
        """Return one number of every cycle, shape (n,) or (n, 3)."""
        return np.array([getattr(cycle, name) for cycle in self.cycles])

    @property
    def with_target(self) -> bool:
        """True where the evader has a place to reach (TAD)."""
        return self.settings.cycle.target_game_m is not None


def story_of(path: Path, settings_of: SettingsOf) -> Story:
    """Read a record into arrays.

    Raises:
        ConfigError: If it cannot be read, or holds no cycle.
    """
    metadata, survey = metadata_of(path), Survey()
    settings = settings_of(metadata)
    aggregator = Aggregator(settings)
    rows = cycles_of(path, survey)
    told = [(aggregator.cycle(row), row.state, row.certificate, row.alarm) for row in rows]
    if not told:
        raise ConfigError(f"{path}: holds no guidance cycle: there is nothing to report")
    certificates = tuple(certificate for _, _, certificate, _ in told)
    states = tuple(state for _, state, _, _ in told)
    playing = [number for number, one in enumerate(certificates) if one is not None]
    reached = [number for number in playing if (one := certificates[number]) is not None and one.captured]
    return Story(
        title_of(metadata),
        settings,
        survey,
        tuple(events_of(path)),
        states,
        certificates,
        tuple((cycle.now_s, str(alarm.violation)) for cycle, _, _, alarm in told if alarm is not None),
        aggregator.home_m,
        aggregator.envelope,
        tuple(cycle for cycle, _, _, _ in told),
        playing[0] if playing else None,
        reached[0] if reached else None,
        _first_s(told, State.ENGAGED),
        _first_s(told, State.ON_STATION),
    )


def _first_s(told: Sequence[tuple[Cycle, str, object, object]], wanted: State) -> float:
    return next((cycle.now_s for cycle, state, _, _ in told if state == wanted), math.nan)
