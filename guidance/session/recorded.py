"""The settings a record was flown with, as its metadata has them, and the same with some of them changed."""

import json
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any, Final

from guidance.config import parse
from guidance.errors import ConfigError
from guidance.flight import FlightSettings
from guidance.log.reader import CONFIG, SCENARIO
from guidance.session.spec import plan_of
from guidance.session.vehicle_file import Config
from guidance.sim.scenario import Scenario

_SHORT: Final = {SCENARIO: {"policy": "pursuer.policy"}, CONFIG: {"policy": "game.policy"}}
"""What people say for the longer key."""


def recorded_settings(metadata: Mapping[str, str], changes: Mapping[str, Any] | None = None) -> FlightSettings:
    """Return the settings of the recorded flight, changed.

    Args:
        metadata: Of the record; holds a mocked flight's `scenario`, a daemon's `config`, or both where a vehicle flew
            a scenario, as JSON.
        changes: Dotted key -> value.

    Raises:
        ConfigError: If the record has neither, or a changed key does not exist or is out of range.
    """
    kind = next((kind for kind in (SCENARIO, CONFIG) if kind in metadata), None)
    if kind is None:
        known = ", ".join(sorted(metadata)) or "nothing"
        raise ConfigError(f"the record's metadata has no scenario and no config, only {known}: it cannot be replayed")
    document = json.loads(metadata[kind])
    changes = changes or {}
    for key, value in changes.items():
        _set(document, _SHORT[kind].get(key, key), value)
    source = f"the record's {kind}" + (f" with {', '.join(changes)} changed" if changes else "")
    if kind == CONFIG:
        return plan_of(parse(Config, document, source=source)).flight
    config = None
    if CONFIG in metadata:
        config = parse(Config, json.loads(metadata[CONFIG]), source="the record's config")
    return plan_of(config, parse(Scenario, document, source=source)).flight


def changes_of(words: Sequence[str]) -> dict[str, Any]:
    """Read KEY=VALUE words; a value is TOML where it can be, else text.

    Raises:
        ConfigError: If a word has no equals sign.
    """
    changes = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not key:
            raise ConfigError(f"--with {word}: must be KEY=VALUE, as policy=pure_pursuit or pursuer.speed_m_s=4.0")
        try:
            changes[key.strip()] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            changes[key.strip()] = value
    return changes


def _set(document: dict[str, Any], key: str, value: Any) -> None:  # noqa: ANN401 - whatever TOML holds
    *sections, name = key.split(".")
    for section in sections:
        if document.get(section) is None:
            document[section] = {}
        document = document[section]
        if not isinstance(document, dict):
            raise ConfigError(f"--with {key}={value}: {section} is no section; its value is {document!r}")
    document[name] = value
