"""Expected outcomes of a scenario, which make it a test: `expect.capture_time_s = { max = 12 }`."""

from collections.abc import Iterator, Mapping
from typing import Any, Final, Literal, NamedTuple, TypeAlias

from pydantic import Field, field_validator, model_validator

from guidance.config import RENAMED_EVENTS, Section

EndName: TypeAlias = Literal["captured", "arrived", "time_up", "yielded", "failed"]
"""End of a run: capture, arrival at the target, time limit, takeover by a pilot, or failure."""


WINNERS: Final[Mapping[str, str]] = {"captured": "pursuer", "arrived": "evader"}
"""Winner of an end; other ends have none."""


class Range(Section):
    """A closed interval from `min` to `max`; one of them may be omitted."""

    min: float | None = Field(None, description="at least this")
    max: float | None = Field(None, description="at most this")

    def _faults(self) -> Iterator[str]:
        if self.min is None and self.max is None:
            yield "{}: empty; give min, max or both"
        if self.min is None or self.max is None:
            return
        if self.min > self.max:
            yield f"min = {self.min:g} is above max = {self.max:g}: no value meets both"

    def holds(self, value: float) -> bool:
        """Return True if a value lies within; NaN does not."""
        is_high_enough = self.min is None or value >= self.min
        is_low_enough = self.max is None or value <= self.max
        return is_high_enough and is_low_enough

    def __str__(self) -> str:
        """Text for the table of expectations."""
        bounds = []
        if self.min is not None:
            bounds.append(f"at least {self.min:g}")
        if self.max is not None:
            bounds.append(f"at most {self.max:g}")
        return " and ".join(bounds)


class CheckedExpectation(NamedTuple):
    """One expectation, the value, and whether it held."""

    column: str
    expected: str
    value: Any
    held: bool


class Ranges(Section):
    """Expected texts and ranges of columns, and sections with those of one kind of run."""

    def verdicts(self, values: Mapping[str, Any]) -> Iterator[CheckedExpectation]:
        """Yield the verdict on everything that is expected, from the values of all columns."""
        for column, expected in self:
            value: Any = values.get(column)
            match expected:
                case Range():
                    holds = expected.holds(value)
                    yield CheckedExpectation(column, str(expected), value, holds)
                case str():
                    yield CheckedExpectation(column, expected, value, value == expected)
                case tuple():
                    events = ", ".join(value)
                    for event in expected:
                        yield CheckedExpectation(column, f"has {event!r}", events, event in value)
                case Ranges() if (column == "maths") == (values["run"] == "maths"):
                    yield from expected.verdicts(values)


RENAMED_COLUMNS: Final[Mapping[str, str]] = {
    "final_distance_m": "evader_to_target_m (tad) or distance_to_disc_m (pe)",
    "predicted": "predicted_capture_time_s (pe) or predicted_evader_to_target_m (tad)",
    "achieved": "capture_time_s (pe) or evader_to_target_m (tad)",
}
"""Columns of older versions; a recorded scenario names them without an expectation."""


class Expectations(Ranges):
    """Expected values of the outcome's columns with the same names."""

    end: EndName | None = Field(None, description="how the run ends")
    winner: Literal["pursuer", "evader", "none"] | None = Field(None, description="who wins")
    capture_time_s: Range | None = Field(None, description="from engagement to the capture")
    distance_to_disc_m: Range | None = Field(
        None, description="of the pursuer from the stand-off disc at the end"
    )
    evader_to_target_m: Range | None = Field(
        None, description="TAD: of the evader from its target at the end"
    )
    predicted_capture_time_s: Range | None = Field(
        None, description="PE: the game's value at engagement"
    )
    predicted_evader_to_target_m: Range | None = Field(
        None, description="TAD: value at engagement if the pursuer wins"
    )
    predicted_short_m: Range | None = Field(
        None, description="TAD: how short of a capture, if the evader is to win"
    )
    time_needed_s: Range | None = Field(None, description="what the vehicle promised at engagement")
    regret: Range | None = Field(
        None, description="what the pursuer lost against the value, s or m"
    )
    ratio: Range | None = Field(None, description="achieved over predicted")
    reachable_speed_m_s: Range | None = Field(
        None, description="smallest speed that the vehicle was seen to reach"
    )
    min_standoff_m: Range | None = Field(None, description="least level distance of the players")
    min_altitude_m: Range | None = Field(None, description="least height of the pursuer")
    alarms: Range | None = Field(None, description="number of broken guarantees")
    events: tuple[str, ...] = Field((), description="events from engagement on")

    @model_validator(mode="before")
    @classmethod
    def _check_columns(cls, document: Any) -> Any:  # noqa: ANN401 - whatever a file holds
        if not isinstance(document, dict):
            return document
        for column, name in RENAMED_COLUMNS.items():
            if document.get(column) is not None:
                raise ValueError(f"expect.{column} is named {name} now")
        return {key: value for key, value in document.items() if key not in RENAMED_COLUMNS}

    @field_validator("events")
    @classmethod
    def _check_events(cls, events: tuple[str, ...]) -> tuple[str, ...]:
        for event in RENAMED_EVENTS.keys() & events:
            raise ValueError(f"{event!r} is named {RENAMED_EVENTS[event]!r} now")
        return events

    def contradictions(self, game: str) -> Iterator[str]:
        """Yield which two expectations cannot both be met in a game of a kind."""
        expected_end = f"expect.end = {self.end!r}"
        if self.end not in {None, "captured"} and self.capture_time_s is not None:
            yield f"expect.capture_time_s contradicts {expected_end}: there is no capture then"
        if self.end == "arrived" and game == "pe":
            yield f'{expected_end}: game = "pe" has no place to arrive at'
        winner = WINNERS.get(str(self.end))
        if winner is None or self.winner is None:
            return
        if self.winner != winner:
            yield f"expect.winner = {self.winner!r} contradicts {expected_end}: {winner} wins then"


class Expect(Expectations):
    """Expectations of every run, and those of mathematics or of flights only."""

    maths: Expectations = Field(Expectations(), description="only for runs as mathematics")
    flown: Expectations = Field(Expectations(), description="only for flights")
