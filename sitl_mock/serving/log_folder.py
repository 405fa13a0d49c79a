"""Flight logs as files: what `sitl-mock run --logs FOLDER` writes there."""

from collections.abc import Mapping
from pathlib import Path

from sitl_mock.errors import ConfigError
from sitl_mock.faults import Faulted
from sitl_mock.logs import FlightLog

_EVERY_S = 1.0


class LogFolder:
    """Writes each vehicle's finished logs to `FOLDER/VEHICLE/NAME`, and the running ones at the end.

    Args:
        folder: An existing folder, or one to be made; None writes nothing.
        vehicles: The vehicles by name.

    Raises:
        ConfigError: The folder cannot be made.
    """

    def __init__(self, folder: Path | None, vehicles: Mapping[str, Faulted]) -> None:
        self._vehicles: Mapping[str, Faulted] = {}
        self._folders: dict[str, Path] = {}
        if folder is not None:
            self._vehicles = vehicles
            self._folders = {name: folder / name for name in vehicles}
        self._written: dict[str, int] = {}
        self._next_s = 0.0
        for path in self._folders.values():
            try:
                path.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise ConfigError(f"--logs {folder}: {path}: {error.strerror}") from error

    def update(self, now_s: float) -> None:
        """Write the logs that have been finished; called often, acts once a second."""
        if now_s < self._next_s:
            return
        self._next_s = now_s + _EVERY_S
        for name, vehicle in self._vehicles.items():
            logs = vehicle.vehicle.autopilot.storage.logs
            for log in logs.logs:
                if log is not logs.running:
                    self._write(name, log)

    def close(self) -> None:
        """Write all logs."""
        for name, vehicle in self._vehicles.items():
            for log in vehicle.vehicle.autopilot.storage.logs.logs:
                self._write(name, log)

    def _write(self, name: str, log: FlightLog) -> None:
        path = self._folders[name] / log.path.removeprefix("/logs/").removeprefix("/log/").replace(
            "/", "_"
        )
        if self._written.get(str(path)) == len(log.content):
            return
        try:
            path.write_bytes(log.content)
        except OSError as error:
            raise ConfigError(f"--logs: {path} cannot be written: {error.strerror}") from error
        self._written[str(path)] = len(log.content)
