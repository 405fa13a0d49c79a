"""Members that files name: those of this package, and those that other packages add."""

import contextlib
from collections.abc import Mapping
from importlib.metadata import EntryPoints, entry_points
from typing import Any, TypeVar

from pydantic import Field

from guidance.errors import ConfigError

Registered = TypeVar("Registered")


class Registry(dict[str, Registered]):
    """Members by name.

    A package adds one with `add` when it is imported, or names it in the entry point group. The entry point has the
    name of its member, and is imported when a file gives that name. So a package that cannot be imported stops only
    its users.

    Args:
        noun: What a member is, as messages call it: ``autopilot``.
        key: The key of files that names one.
        group: Name of the entry point group.
        members: Those of this package.
    """

    def __init__(self, noun: str, key: str, group: str, members: Mapping[str, Registered]) -> None:
        super().__init__(members)
        self.noun = noun
        self.key = key
        self.group = group

    def add(self, name: str, member: Registered) -> None:
        """Add a member.

        Raises:
            ConfigError: If another one has this name.
        """
        if self.setdefault(name, member) is not member:
            raise ConfigError(f"{self.noun} {name!r}: another one has this name; choose a new name")

    @property
    def installed(self) -> EntryPoints:
        """The entry points of installed packages."""
        return entry_points(group=self.group)

    @property
    def names(self) -> list[str]:
        """All names: those of members, and those of installed packages, which are not imported for it."""
        return list(dict.fromkeys((*self, *sorted(self.installed.names))))

    def knows(self, name: str) -> bool:
        """True if a member or an installed package has this name. Packages are read only if no member has it."""
        return name in self or name in self.installed.names

    def named(self, name: str) -> Registered:
        """Return a member; import its package if it is not there yet.

        Raises:
            ConfigError: If there is none of this name, or if its package cannot be imported.
        """
        if name not in self:
            for entry_point in self.installed.select(name=name):
                try:
                    member: Registered = entry_point.load()
                except Exception as error:
                    package = "an installed package"
                    if entry_point.dist is not None:
                        package = f"the package {entry_point.dist.name} {entry_point.dist.version}"
                    raise ConfigError(
                        f"{self.key} = {entry_point.name!r}: {package} cannot be imported "
                        f"({type(error).__name__}: {error}); repair it or uninstall it"
                    ) from error
                self.add(name, member)
        if name not in self:
            raise ConfigError(f"{self.key} = {name!r}: allowed are {', '.join(self.names)}")
        return self[name]

    def importable(self) -> dict[str, Registered]:
        """Return all members by name, without those of packages that cannot be imported."""
        members = dict[str, Registered]()
        for name in self.names:
            with contextlib.suppress(ConfigError):
                members[name] = self.named(name)
        return members

    def checked_name(self, name: str) -> str:
        """Return a name that a file gives, if it has a member; a validator of pydantic.

        Raises:
            ValueError: If there is none of this name, or if its package cannot be imported.
        """
        if not self.knows(name):
            raise ValueError(f"must be one of {', '.join(self.names)}")
        try:
            self.named(name)
        except ConfigError as error:
            raise ValueError(str(error).partition(": ")[2]) from error
        return name

    def names_in_schema(self) -> Any:  # noqa: ANN401 - pydantic's own type of a field's description
        """Return the description of a key that names a member: its JSON schema lists all names."""
        return Field(json_schema_extra=lambda schema: schema.update(enum=[*self.names]))
