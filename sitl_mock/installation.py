"""The distributions that install this package: the mock's own, and the whole project's, which has the same files."""

from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Final

from sitl_mock.errors import ConfigError

_DISTRIBUTIONS: Final = ("pursuit-sitl-mock", "pursuit-guidance")


def installed_versions() -> dict[str, str]:
    """Return the version of each installed distribution that has this package, the mock's own first."""
    versions = {}
    for name in _DISTRIBUTIONS:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return versions


def require_one_version(versions: Mapping[str, str]) -> None:
    """Refuse two distributions of different versions: the later one has overwritten files of the other.

    Raises:
        ConfigError: The versions differ.
    """
    if len(set(versions.values())) > 1:
        named = " and ".join(f"{name} {number}" for name, number in versions.items())
        raise ConfigError(
            f"sitl_mock is installed twice, by {named}, and its files are a mixture: "
            "pip uninstall pursuit-sitl-mock, then install pursuit-guidance again with --force-reinstall"
        )
