"""The flavours and their versions by name; without imports, so that a test run can list them before it uses any."""

from collections.abc import Mapping, Sequence
from itertools import chain
from types import MappingProxyType

VERSIONS: Mapping[str, Sequence[str]] = MappingProxyType(
    {
        "px4": ("1.17", "1.18"),
        "arducopter": ("4.5", "4.7"),
        "rover": ("4.5",),
    }
)
"""Versions of each flavour; the first one has recorded data and is the default."""

NAMES: Sequence[str] = tuple(VERSIONS)


def specs_of(name: str) -> list[str]:
    """Return every version of a flavour as it stands on the command line: px4@1.17, px4@1.18."""
    return [f"{name}@{version}" for version in VERSIONS[name]]


SPECS: Sequence[str] = (*NAMES, *chain.from_iterable(specs_of(name) for name in NAMES))
"""Everything that may name a flavour: its name for the default version, or name@version."""
