"""Options that mean something with some commands or ways only: given with another, one is refused, never ignored."""

from collections.abc import Mapping
from typing import Any

from guidance.errors import ConfigError


def refuse_others(way: str, given: Mapping[str, Any], belonging: Mapping[str, str]) -> None:
    """Refuse an option that was given and belongs to something else.

    Args:
        way: What is done, as it was asked for: "--as maths".
        given: Values by option; what is None or False was not given.
        belonging: What an option belongs to, in words, for those that do not belong to `way`.

    Raises:
        ConfigError: With the option's name, and what it belongs to.
    """
    for option, where in belonging.items():
        value = given.get(option)
        if value is not None and value is not False:
            raise ConfigError(f"{option}: only {where}, not with {way}; leave it out")
