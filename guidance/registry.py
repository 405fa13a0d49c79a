"""Members that files name: those of this package, and those that other packages add."""

from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import Any, TypeVar

from pydantic import Field

from guidance.errors import ConfigError

Registered = TypeVar("Registered")


class Registry(dict[str, Registered]):
    """Members by name.

    A package adds one with `add` when it is imported, or names it in the entry point group. That is read when a name
    is unknown. The entry point has the name of its member.

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

    def load(self, name: str | None = None) -> None:
        """Add the members of a name that installed packages have; all of them without a name."""
        for installed in entry_points(group=self.group):
            if name in {None, installed.name}:
                self.add(installed.name, installed.load())

    def named(self, name: str) -> Registered:
        """Return a member.

        Raises:
            ConfigError: If there is none of this name.
        """
        if name not in self:
            self.load(name)
        if name not in self:
            raise ConfigError(f"{self.key} = {name!r}: allowed are {', '.join(self)}")
        return self[name]

    def checked_name(self, name: str) -> str:
        """Return a name that a file gives, if it has a member; a validator of pydantic.

        Raises:
            ValueError: If there is none of this name.
        """
        try:
            self.named(name)
        except ConfigError:
            raise ValueError(f"must be one of {', '.join(self)}") from None
        return name

    def names_in_schema(self) -> Any:  # noqa: ANN401 - pydantic's own type of a field's description
        """Return the description of a key that names a member: its JSON schema lists all names."""
        return Field(json_schema_extra=lambda schema: schema.update(enum=list(self)))
