"""Fault scripts: seeded TOML files with checked keys.

    seed = 7

    [[fault]]
    kind = "pilot_mode"     # see `sitl-mock list faults`
    mode = "POSCTL"         # a key of that kind
    vehicle = "uav1"        # name or list of names; default: all
    after = "OFFBOARD"      # event to wait for: a mode, ARMED, DISARMED, AIRBORNE, LANDED, READY; default: power-on
    at_s = 2.0              # seconds after the event
    for_s = 5.0             # duration; default: that of the kind

Faults of frames also have `link`, and the open ones `direction` (out, in, both) and `messages`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.errors import ConfigError
from sitl_mock.faults.contents import ACK_KINDS, CONTENT_KINDS
from sitl_mock.faults.effect import Direction, FaultKind
from sitl_mock.faults.evader import EVADER_KINDS
from sitl_mock.faults.links import LINK_KINDS
from sitl_mock.faults.other_senders import OTHER_SENDER_KINDS
from sitl_mock.faults.places import PLACE_KINDS
from sitl_mock.faults.vehicle import FLIGHT_KINDS
from sitl_mock.mavlink import SPEC_BY_NAME
from sitl_mock.tables import (
    Option,
    checked,
    choice,
    filled,
    integer,
    number,
    read_toml,
    text,
    words,
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {
        **LINK_KINDS,
        **ACK_KINDS,
        **CONTENT_KINDS,
        **PLACE_KINDS,
        **OTHER_SENDER_KINDS,
        **FLIGHT_KINDS,
        **EVADER_KINDS,
    }
)


EVERY: Final = "*"
_FOREVER_S: Final = 1e9
_SEED: Final = Option("seed", 0, integer(0, 2**63))


def _message_names(value: Any) -> tuple[str, ...]:  # noqa: ANN401 - anything may stand in a file
    names = words(value)
    if not set(names) <= SPEC_BY_NAME.keys():
        raise ValueError("names of MAVLink messages, such as COMMAND_ACK")
    return names


_COMMON: Final = {
    "vehicle": Option("vehicles", (EVERY,), words),
    "after": Option("event", "", text),
    "at_s": Option("seconds after it", 0.0, number(0.0, _FOREVER_S)),
}
_FRAMES: Final = {"link": Option("link", "", choice("onboard", "gcs"))}
_OPEN: Final = {
    "direction": Option("direction", Direction.OUT, choice(*Direction)),
    "messages": Option("messages", (), _message_names),
}


@dataclass(frozen=True)
class Fault:
    """One fault of a script; `KINDS` describes its kind.

    Attributes:
        kind: Name of the kind.
        options: Checked keys of the kind with defaults.
        vehicle: Names of the affected vehicles, or EVERY.
        after: Event that starts the time at_s; empty for power-on.
        at_s: Delay after the event.
        for_s: Duration.
        link: The affected link; empty for all.
        direction: Direction of the affected frames.
        messages: Names of the affected messages; empty for all.
    """

    kind: str
    options: Mapping[str, Any] = field(default_factory=dict)
    vehicle: tuple[str, ...] = (EVERY,)
    after: str = ""
    at_s: float = 0.0
    for_s: float = math.inf
    link: str = ""
    direction: Direction = Direction.OUT
    messages: tuple[str, ...] = ()

    def strikes(self, vehicle: str) -> bool:
        """True if the fault affects a vehicle."""
        return EVERY in self.vehicle or vehicle in self.vehicle


@dataclass(frozen=True)
class FaultScript:
    """Faults and the seed of their randomness."""

    faults: tuple[Fault, ...] = ()
    seed: int = 0

    def check_vehicles(self, names: list[str]) -> None:
        """Check that every named vehicle exists.

        Raises:
            ConfigError: One does not.
        """
        for index, fault in enumerate(self.faults):
            for name in fault.vehicle:
                if name not in {EVERY, *names}:
                    raise ConfigError(
                        f"fault[{index}].vehicle = {name!r}: allowed are {', '.join([*names, EVERY])}"
                    )


def read_script(path: Path) -> FaultScript:
    """Read a script from a TOML file.

    Raises:
        ConfigError: The file cannot be read, or a key is unknown, missing or wrong.
    """
    return parse_script(read_toml(path, "faults file"), str(path))


def parse_script(values: Mapping[str, Any], source: str = "faults") -> FaultScript:
    """Turn the values of a file into a script.

    Raises:
        ConfigError: A key is unknown, missing or wrong; the message has the key, its value and the allowed ones.
    """
    unknown = sorted(values.keys() - {"seed", "fault"})
    if unknown:
        raise ConfigError(
            f"{source}: {unknown[0]} = {values[unknown[0]]!r} is not known; allowed are seed and [[fault]]"
        )
    entries = values.get("fault", [])
    if not isinstance(entries, list):
        raise ConfigError(f"{source}: fault = {entries!r}: allowed is a list, written as [[fault]]")
    seed = checked(f"{source}: seed", values.get("seed", 0), _SEED)
    return FaultScript(
        tuple(
            parse_fault(entry, f"{source}: fault[{index}]") for index, entry in enumerate(entries)
        ),
        seed,
    )


def parse_fault(values: Any, where: str = "fault") -> Fault:  # noqa: ANN401 - anything may stand in a file
    """Turn the keys of one fault into a value.

    Raises:
        ConfigError: As `parse_script`.
    """
    if not isinstance(values, dict):
        raise ConfigError(f"{where} = {values!r}: allowed is a table of keys")
    name = values.get("kind")
    kind = KINDS.get(name) if isinstance(name, str) else None
    if kind is None and str(name).replace("target_", "evader_") in KINDS:
        raise ConfigError(
            f"{where}.kind = {name!r}: use {str(name).replace('target_', 'evader_')}, its new name"
        )
    if kind is None:
        raise ConfigError(f"{where}.kind = {name!r}: allowed are {', '.join(KINDS)}")
    # Keys of all kinds, with the defaults of this kind.
    common = {**_COMMON, "for_s": Option("seconds", kind.for_s, number(0.0, _FOREVER_S))}
    if kind.scope is not None:
        common |= _FRAMES
        scope = {"direction": kind.scope.direction, "messages": kind.scope.messages}
        for key, option in _OPEN.items():
            check = option.check if kind.scope.open else choice()
            common[key] = Option(option.meaning, scope[key], check)
    unknown = sorted(values.keys() - {"kind"} - common.keys() - kind.options.keys())
    if unknown:
        allowed = ", ".join((*kind.options, *common))
        raise ConfigError(
            f"{where}.{unknown[0]} = {values[unknown[0]]!r}: {name} has no such key; allowed are {allowed}"
        )
    shared = filled(values, common, where)
    if "direction" in shared:
        shared["direction"] = Direction(shared["direction"])
    return Fault(str(name), filled(values, kind.options, where), **shared)
