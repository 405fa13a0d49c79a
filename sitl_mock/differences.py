"""What differs between two versions of a flavour, as the mock has them: parameters, commands, modes and messages."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from sitl_mock.errors import ConfigError
from sitl_mock.flavours import flavour_named
from sitl_mock.mavlink.definitions import command_names
from sitl_mock.protocols import ParameterTable
from sitl_mock.telemetry import builders_of
from sitl_mock.versions import specs_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sitl_mock.protocols import Parameter
    from sitl_mock.vehicle.flavour import Flavour


class VersionDifference(NamedTuple):
    """One difference.

    Attributes:
        subject: parameter, command, mission item, mode, message, or stream.
        first: What the first version has, "" for nothing.
        second: What the second version has, "" for nothing.
        note: How a value of the first becomes one of the second, or another remark.
    """

    subject: str
    first: str
    second: str
    note: str = ""


def differences_of(first: str, second: str) -> list[VersionDifference]:
    """Return all differences of two versions, given as on the command line.

    Raises:
        ConfigError: There is no such version, or they are of two flavours.
    """
    before = flavour_named(first)
    after = flavour_named(second)
    if before.name != after.name:
        raise ConfigError(
            f"versions {first} {second}: give two versions of one flavour, as px4@1.17 px4@1.18"
        )
    return [
        *_parameter_differences(before, after),
        *_command_differences("command", _version_commands(before), _version_commands(after)),
        *_command_differences(
            "mission item", before.mission_rules.commands, after.mission_rules.commands
        ),
        *_mode_differences(before, after),
        *_message_differences(before, after),
    ]


def _parameter_table(flavour: Flavour) -> ParameterTable:
    parameters = flavour.parameters
    return parameters if isinstance(parameters, ParameterTable) else ParameterTable(parameters)


def _parameter_differences(before: Flavour, after: Flavour) -> Iterator[VersionDifference]:
    old = _parameter_table(before)
    new = _parameter_table(after)
    later = {renamed.name: (was, renamed.factor) for was, renamed in new.renamed.items()}
    earlier = {renamed.name: (was, 1.0 / renamed.factor) for was, renamed in old.renamed.items()}
    renamed = {was: name for name, (was, _) in later.items()} | {
        name: was for name, (was, _) in earlier.items()
    }
    for name, item in old.definitions.items():
        if name in renamed:
            other = new.definitions[renamed[name]]
            factor = later[other.name][1] if other.name in later else earlier[name][1]
            note = "" if factor == 1.0 else f"value × {factor:g}"
            yield VersionDifference(
                "parameter", _parameter_words(item), _parameter_words(other), note
            )
        elif name not in new.definitions:
            yield VersionDifference("parameter", _parameter_words(item), "")
        elif item != new.definitions[name]:
            other = new.definitions[name]
            yield VersionDifference(
                "parameter", _parameter_words(item), _parameter_words(other), other.meaning
            )
    for name, item in new.definitions.items():
        if name not in old.definitions and name not in renamed.values():
            yield VersionDifference("parameter", "", _parameter_words(item), item.meaning)


def _parameter_words(item: Parameter) -> str:
    unit = f" {item.unit}" if item.unit else ""
    return f"{item.name} = {item.default:g}{unit}"


def _version_commands(flavour: Flavour) -> frozenset[int]:
    """Return those commands of a version that not all versions have."""
    versions = [flavour_named(spec) for spec in specs_of(flavour.name)]
    refused = frozenset[int]().union(*(version.refused_commands for version in versions))
    return (refused - flavour.refused_commands) | flavour.more_commands


def _command_differences(
    subject: str, before: frozenset[int], after: frozenset[int]
) -> Iterator[VersionDifference]:
    for number in sorted(before - after):
        yield VersionDifference(subject, _command_words(number), "")
    for number in sorted(after - before):
        yield VersionDifference(subject, "", _command_words(number))


def _command_words(number: int) -> str:
    name = command_names().get(number)
    return str(number) if name is None else f"{number} {name}"


def _mode_differences(before: Flavour, after: Flavour) -> Iterator[VersionDifference]:
    old = {mode.name: mode.number for mode in before.modes.modes}
    new = {mode.name: mode.number for mode in after.modes.modes}
    for name in [*old, *(name for name in new if name not in old)]:
        if old.get(name) != new.get(name):
            yield VersionDifference("mode", _mode(name, old), _mode(name, new))


def _mode(name: str, numbers: dict[str, int]) -> str:
    return f"{name} ({numbers[name]})" if name in numbers else ""


def _message_differences(before: Flavour, after: Flavour) -> Iterator[VersionDifference]:
    offered = {*builders_of(before.name), "AVAILABLE_MODES"}
    for name in sorted(offered & (after.withheld - before.withheld)):
        yield VersionDifference("message", name, "")
    for name in sorted(offered & (before.withheld - after.withheld)):
        yield VersionDifference("message", "", name)
    if before.takes_keys != after.takes_keys:
        first = "SETUP_SIGNING" if before.takes_keys else ""
        second = "SETUP_SIGNING" if after.takes_keys else ""
        yield VersionDifference("message", first, second, "sets the key of MAVLink signing")
    for link, rates in before.rates_hz.items():
        others = after.rates_hz[link]
        for name in sorted({*rates, *others}):
            if rates.get(name) != others.get(name):
                first = _rate(name, rates.get(name))
                yield VersionDifference(
                    "stream", first, _rate(name, others.get(name)), f"{link} link"
                )


def _rate(name: str, rate_hz: float | None) -> str:
    return "" if rate_hz is None else f"{name} {rate_hz:g} Hz"
