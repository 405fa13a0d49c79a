"""Reads TOML files of limited size. Imports nothing heavy: an order by a router reads its settings with it."""

import re
import tomllib
from pathlib import Path
from typing import Any, Final

from guidance.errors import ConfigError
from guidance.files import read_text

LARGEST_CONFIG_BYTES: Final = 2**19
"""Every two bytes can become a table. A fence of 1,000 corners takes 0.1 MB."""

MOST_KEY_PARTS: Final = 16
"""The parser's memory grows with the square of the parts of a dotted key; ours have at most five."""

_LONG_KEY = re.compile(
    rf"""(?<![\w-])(?:(?:[\w-]+|"(?:\\.|[^"\\\n]){{,99}}"|'[^'\n]{{,99}}')\s*\.\s*){{{MOST_KEY_PARTS}}}"""
)


def read(path: Path) -> tuple[str, dict[str, Any]]:
    """Read a configuration file; return its text and its keys, unchecked.

    Raises:
        ConfigError: If it cannot be read or is not TOML; the message gives the line.
    """
    try:
        text = read_text(path, LARGEST_CONFIG_BYTES)
        if _LONG_KEY.search(text):
            raise ConfigError(
                f"{path}: not valid TOML here: a key has more than {MOST_KEY_PARTS} parts"
            )
        if not _within_64_bits(document := tomllib.loads(text)):
            raise ConfigError(f"{path}: not valid TOML: an integer has more than 64 bits")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except RecursionError:
        raise ConfigError(
            f"{path}: not valid TOML here: arrays or tables are nested too deeply"
        ) from None
    except ValueError as error:
        # It is not UTF-8, not TOML, or has an integer with thousands of digits.
        raise ConfigError(f"{path}: not valid TOML: {error}") from error
    return text, document


def _within_64_bits(value: Any) -> bool:  # noqa: ANN401 - any value of a document
    if isinstance(value, dict):
        return all(map(_within_64_bits, value.values()))
    if isinstance(value, list):
        return all(map(_within_64_bits, value))
    return not isinstance(value, int) or -(2**63) <= value < 2**63
