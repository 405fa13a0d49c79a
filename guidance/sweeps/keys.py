"""The name of a key of a scenario, as `pursuer.speed_m_s` or `evader.position_m[0]`, and a document with it set."""

import re
from typing import Any, NamedTuple

from guidance.errors import ConfigError

_PART = re.compile(r"(?P<name>[a-z_][a-z0-9_]*)(?P<places>(\[\d+\])*)")

_FIXED = {
    "title": "it names the scenario",
    "description": "it says what the scenario is about",
    "game": "give each game a sweep of its own, and compare the two",
    "seed": "use seeds = 100, or a list of them",
    "expect": "a sweep has a report and no expectations",
    "policy": "use policies = [{ pursuer = …, evader = … }]",
    "waypoints_m": "it belongs to a policy; put it into the scenario",
    "track": "it belongs to a policy; put it into the scenario",
}
"""What is not swept, and what is to be done instead."""


class Key(NamedTuple):
    """A key of a scenario: its text, and the way to it by name and place."""

    text: str
    path: tuple[str | int, ...]

    def at(self, place: int) -> "Key":
        """Return the key of one element of a vector."""
        return Key(f"{self.text}[{place}]", (*self.path, place))


def key_of(text: str) -> Key:
    """Read a key's name.

    Raises:
        ConfigError: If it is none, or one that is not swept.
    """
    path: list[str | int] = []
    for part in text.split("."):
        found = _PART.fullmatch(part)
        if found is None:
            raise ConfigError(f"{text!r}: must be a scenario's key as in pursuer.speed_m_s or evader.position_m[0]")
        path.append(found["name"])
        path.extend(int(place) for place in re.findall(r"\d+", found["places"]))
    names = [part for part in path if isinstance(part, str)]
    for name in (names[0], names[-1]):
        if name in _FIXED:
            raise ConfigError(f"{text}: cannot be swept; {_FIXED[name]}")
    return Key(text, tuple(path))


def placed(node: Any, path: tuple[str | int, ...], value: Any) -> Any:  # noqa: ANN401 - any part of a document
    """Return a copy of a part of a document with a value at a path; nothing that is given is changed.

    Raises:
        LookupError: If an element is asked for where there is no vector, or beyond its end.
    """
    if not path:
        return value
    head, rest = path[0], path[1:]
    if isinstance(head, int):
        if not isinstance(node, (list, tuple)) or head >= len(node):
            raise LookupError(head)
        elements = list(node)
        elements[head] = placed(elements[head], rest, value)
        return elements
    section = node or {}
    return {**section, head: placed(section.get(head), rest, value)}
