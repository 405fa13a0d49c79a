"""What the base installation leaves out: which extra brings a package that is missing, and how to add it."""

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
}
"""The packages that each extra is missed by."""


def require(what: str, *extras: str) -> None:
    """See that extras are installed, before any work is done.

    Args:
        what: What needs them, as the user named it: a command, an option or a file.
        extras: Names of `EXTRAS`.

    Raises:
        ConfigError: If one is missing; the message says how to add it.
    """
    advice = how_to_add(*extras)
    if advice is not None:
        raise ConfigError(f"{what}: {advice}")


def how_to_add(*extras: str) -> str | None:
    """Say what is missing of some extras and how to add it; None if nothing is."""
    missing = {extra: [name for name in EXTRAS[extra] if find_spec(name) is None] for extra in extras}
    lacking = [extra for extra, names in missing.items() if names]
    if not lacking:
        return None
    packages = ", ".join(name for extra in lacking for name in missing[extra])
    are = "are" if "," in packages else "is"
    return f"needs {packages}, which {are} not installed: pip install 'pursuit-guidance[{','.join(lacking)}]'"
