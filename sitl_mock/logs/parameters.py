"""The parameters in a flight log: all at its beginning, and later those that have changed."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sitl_mock.protocols import ParameterStore


class LoggedParameters:
    """The values that the log has."""

    def __init__(self) -> None:
        self._values: dict[str, float] = {}
        self._revision = 0

    def remember(self, parameters: ParameterStore) -> None:
        """Take all present values as logged."""
        self._values = dict(parameters)
        self._revision = parameters.revision

    def changed(self, parameters: ParameterStore) -> list[str]:
        """Return the names of those that differ from the logged values, and take them as logged."""
        if parameters.revision == self._revision:
            return []
        before = self._values
        self.remember(parameters)
        return [name for name, value in self._values.items() if before.get(name) != value]
