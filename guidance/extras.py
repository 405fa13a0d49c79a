"""Optional packages: the extra that installs each of them, and the error that says so."""

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Final

from guidance.errors import ConfigError

EXTRAS: Final[Mapping[str, tuple[str, ...]]] = {
    "sim": ("pyarrow", "scipy"),
    "plot": ("matplotlib",),
    "viz": ("rerun",),
    "panel": ("aiohttp",),
    "cluster": ("distributed",),
    "keys": ("cryptography",),
    "ros": ("rosbags", "xxhash"),
    "league": ("gymnasium", "pettingzoo"),
}
"""Import names of each extra."""


def require_extras(what: str, *extras: str) -> None:
    """Check that extras are installed, before any work begins.

    Args:
        what: The command, option or file that needs them.
        extras: Names of `EXTRAS`.

    Raises:
        ConfigError: If one is missing; the message says how to install it.
    """
    if (advice := how_to_add(*extras)) is not None:
        raise ConfigError(f"{what}: {advice}")


def how_to_add(*extras: str) -> str | None:
    """Return which packages are missing and how to install them; None if all are installed."""
    missing = {name: extra for extra in extras for name in EXTRAS[extra] if find_spec(name) is None}
    if not missing:
        return None
    lacking = ",".join(dict.fromkeys(missing.values()))
    are = "are" if len(missing) > 1 else "is"
    return f"needs {', '.join(missing)}, which {are} not installed: pip install 'pursuit-guidance[{lacking}]'"
