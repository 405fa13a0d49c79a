"""Export by the name of the file that is wanted."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from guidance.errors import ConfigError
from guidance.records.maps import write_geojson, write_kml
from guidance.records.places import features_of
from guidance.records.reading import metadata_of
from guidance.records.settings import flight_settings, title_of
from guidance.records.table import write_csv, write_parquet
from guidance.records.tlog import write_tlog


def _geojson(path: Path, out: Path) -> int:
    metadata = metadata_of(path)
    return write_geojson(features_of(path, flight_settings(metadata, {})), title_of(metadata), out)


def _kml(path: Path, out: Path) -> int:
    metadata = metadata_of(path)
    return write_kml(features_of(path, flight_settings(metadata, {})), title_of(metadata), out)


EXPORTS: Final[Mapping[str, tuple[str, Callable[[Path, Path], int]]]] = {
    ".tlog": ("frames", write_tlog),
    ".csv": ("cycles", write_csv),
    ".parquet": ("cycles", write_parquet),
    ".geojson": ("features", _geojson),
    ".kml": ("features", _kml),
}


def export(path: Path, out: Path) -> str:
    """Write `out` in the format that its name ends in; return how many of what.

    Raises:
        ConfigError: If the ending is unknown, the record cannot be read, or `out` cannot be written.
    """
    if out.suffix not in EXPORTS:
        raise ConfigError(f"{out}: must end in {', '.join(EXPORTS)}")
    what, write = EXPORTS[out.suffix]
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        return f"{write(path, out)} {what}"
    except OSError as error:
        raise ConfigError(f"{out}: cannot be written ({error.strerror or error})") from error
