"""Export by the name of the file that is wanted."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from guidance.errors import ConfigError, OutputError
from guidance.extras import require
from guidance.log.maps import write_geojson, write_kml
from guidance.log.places import Feature, features_of
from guidance.log.reader import SettingsOf, metadata_of, title_of
from guidance.log.tlog import write_tlog


def _geojson(path: Path, out: Path, settings_of: SettingsOf) -> int:
    return write_geojson(*_map(path, settings_of), out)


def _kml(path: Path, out: Path, settings_of: SettingsOf) -> int:
    return write_kml(*_map(path, settings_of), out)


def _map(path: Path, settings_of: SettingsOf) -> tuple[list[Feature], str]:
    metadata = metadata_of(path)
    return features_of(path, settings_of(metadata)), title_of(metadata)


def _csv(path: Path, out: Path, _: SettingsOf) -> int:
    require(str(out), "sim")
    from guidance.log.table import write_csv  # noqa: PLC0415 - pyarrow is of an extra

    return write_csv(path, out)


def _parquet(path: Path, out: Path, _: SettingsOf) -> int:
    require(str(out), "sim")
    from guidance.log.table import write_parquet  # noqa: PLC0415 - as above

    return write_parquet(path, out)


EXPORTS: Final[Mapping[str, tuple[str, Callable[[Path, Path, SettingsOf], int]]]] = {
    ".tlog": ("frames", lambda path, out, _: write_tlog(path, out)),
    ".csv": ("cycles", _csv),
    ".parquet": ("cycles", _parquet),
    ".geojson": ("features", _geojson),
    ".kml": ("features", _kml),
}


def export(path: Path, out: Path, settings_of: SettingsOf) -> str:
    """Write `out` in the format that its name ends in; return how many of what.

    Raises:
        ConfigError: If the ending is unknown, or the record cannot be read.
        OutputError: If `out` cannot be written.
    """
    if out.suffix not in EXPORTS:
        raise ConfigError(f"{out}: must end in {', '.join(EXPORTS)}")
    what, write = EXPORTS[out.suffix]
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        return f"{write(path, out, settings_of)} {what}"
    except OSError as error:
        raise OutputError(f"{out}: cannot be written ({error.strerror or error}); choose another file") from error
