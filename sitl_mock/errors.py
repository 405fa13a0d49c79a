"""Errors for users of the mock. Each message has the key, its value and the allowed values."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_PACKAGES: Final = {"zenoh": "eclipse-zenoh"}
"""Packages whose name is not that of their module."""


class MockError(Exception):
    """Base class of this package's errors; `exit_code` is the exit code of commands."""

    exit_code = 1


class ConfigError(MockError):
    """A setting is wrong."""

    exit_code = 2


class TransportError(MockError):
    """An endpoint cannot be opened, mostly because its port is taken."""

    exit_code = 3


def require_file(path: Path) -> None:
    """Refuse what is there and is no regular file: a pipe would wait for ever, and a device has no end.

    Raises:
        ConfigError: The path is a pipe, a device, a socket or a folder.
    """
    if path.exists() and not path.is_file():
        raise ConfigError(f"{path}: is no regular file; give the name of a recorded file")


LONGEST_RECORDING_S: Final = 4 * 3600.0
"""Longest recorded flight that the mock flies again. A damaged time may say years, and the mock would fly for days."""


def require_span(where: str, span_s: float) -> None:
    """Refuse a recording that is longer than `LONGEST_RECORDING_S`.

    Args:
        where: File, and column if it has any, for the error.
        span_s: From its first to its last time.

    Raises:
        ConfigError: It is longer, or its span is no number.
    """
    if not span_s <= LONGEST_RECORDING_S:
        raise ConfigError(
            f"{where}: the times span {span_s:g} s; a recording may last at most {LONGEST_RECORDING_S:g} s"
        )


@contextlib.contextmanager
def imported_for(purpose: str) -> Iterator[None]:
    """Turn a missing package into an error that names it, its purpose and the command that installs it.

    Raises:
        ConfigError: An import in the block found no such package.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = error.name
        if package in _PACKAGES:
            package = _PACKAGES[package]
        raise ConfigError(
            f"{purpose}: needs {package}, which is not installed: pip install {package}"
        ) from error
