"""Types for a flavour's table of modes, which both the code and the documentation use."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple


class Need(StrEnum):
    """Requirement of a mode."""

    PILOT = "pilot's sticks"
    ALTITUDE = "altitude"
    LOCAL_POSITION = "local position"
    GLOBAL_POSITION = "global position"
    HOME = "home"
    MISSION = "mission"
    STREAM = "setpoint stream"
    DISARMED = "to be disarmed"
    REGISTRATION = "registration by a companion"

    __hash__ = str.__hash__  # Enum's own hash is ten times slower


class Mode(NamedTuple):
    """One mode: name, HEARTBEAT.custom_mode, needs, whether it allows arming, base_mode and meaning."""

    name: str
    number: int
    needs: frozenset[Need]
    may_arm: bool
    base_mode: int
    meaning: str


class Available(NamedTuple):
    """One mode as AVAILABLE_MODES tells it.

    Attributes:
        number: HEARTBEAT.custom_mode.
        standard: MAV_STANDARD_MODE; 0 for none.
        properties: MAV_MODE_PROPERTY: bit 0 advanced, bit 1 not for users to choose.
        name: Name; empty for a standard mode.
    """

    number: int
    standard: int
    properties: int
    name: str


class Transition(NamedTuple):
    """An automatic mode change: on `event` in `mode`, the vehicle changes to `after`."""

    mode: str
    event: str
    after: str


@dataclass(frozen=True)
class ModeTable:
    """The modes of a flavour.

    Attributes:
        title: Name of the flavour.
        modes: Every mode that a client may request.
        transitions: Automatic mode changes.
        rules: Answers to mode requests, in words; one line per rule.
        listed: The modes of AVAILABLE_MODES in their order; by default those of the table, by name.
    """

    title: str
    modes: Sequence[Mode]
    transitions: Sequence[Transition]
    rules: Sequence[str]
    listed: Sequence[Available] = ()

    def available(self) -> Sequence[Available]:
        """Return the modes of AVAILABLE_MODES."""
        if self.listed:
            return self.listed
        return [Available(mode.number, 0, 0, mode.name) for mode in self.modes]

    def by_name(self) -> Mapping[str, Mode]:
        """Return the modes by name."""
        return {mode.name: mode for mode in self.modes}

    def by_number(self) -> Mapping[int, Mode]:
        """Return the modes by HEARTBEAT.custom_mode; the first one if two share a number."""
        return {mode.number: mode for mode in reversed(self.modes)}

    def after(self) -> Mapping[tuple[str, str], str]:
        """Return the transitions as a mapping from (mode, event) to the next mode."""
        return {(row.mode, row.event): row.after for row in self.transitions}

    def markdown(self) -> Iterator[str]:
        """Yield the table as lines of Markdown."""
        yield f"### {self.title}"
        yield ""
        yield "| mode | custom_mode | needs | may arm | meaning |"
        yield "|---|---|---|---|---|"
        for mode in self.modes:
            needs = ", ".join(sorted(mode.needs)) or "nothing"
            number = f"0x{mode.number:08X}" if mode.number > 0xFF else str(mode.number)
            yield f"| {mode.name} | {number} | {needs} | {'yes' if mode.may_arm else 'no'} | {mode.meaning} |"
        yield ""
        yield "| in | when | goes to |"
        yield "|---|---|---|"
        for row in self.transitions:
            yield f"| {row.mode} | {row.event} | {row.after} |"
        yield ""
        for rule in self.rules:
            yield f"- {rule}"
