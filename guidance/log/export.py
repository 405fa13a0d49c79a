"""Exports a record in the format that the ending of the output file selects.

A .tlog is the telemetry log of QGroundControl, Mission Planner and pymavlink's mavlogdump. Each frame follows 8 bytes
with its time in microseconds since 1970, big-endian. Records in virtual time have no UTC start and begin in 1970.

A map has tracks, state changes, fence and goal, as GeoJSON (RFC 7946) or KML 2.2. Altitudes are above mean sea level in
both. RFC 7946 asks for heights above the ellipsoid, but autopilots report mean sea level and most viewers expect it.
"""

import heapq
import json
import math
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.sax.saxutils import escape

from pymavlink.dialects.v20 import all as dialect

from guidance.errors import ConfigError
from guidance.extras import require
from guidance.files import writing
from guidance.flight import FlightSettings
from guidance.flight.tracking import polygon_about_home
from guidance.frames import Amsl, LocalFrame
from guidance.links.frames import FrameReader, frame_length
from guidance.log.aggregator import SettingsOf
from guidance.log.reader import Survey, cycles_of, metadata_of, scan, title_of
from guidance.messages import EvaderReport, GlobalPosition, Home
from guidance.vehicle import VehicleState, observe

ENCODING: Final = "mavlink"
_REORDER_S: Final = 1.0
"""Frames are recorded vehicle by vehicle each cycle, so times within this window may be out of order."""

Coordinates = tuple[float, float, float]
"""Longitude and latitude in degrees, altitude above mean sea level in metres."""

_CIRCLE_CORNERS: Final = 72
_COLOURS: Final = {"pursuer": "ff2d27c1", "evader": "ffa55f0b", "fence": "ff404040"}  # KML: alpha, blue, green, red


class Feature(NamedTuple):
    """One shape on the map: a `LineString`, a `Point`, or a `Polygon` given by its closed edge."""

    name: str
    shape: str
    places: Sequence[Coordinates]
    properties: Mapping[str, Any] = {}


def _map(path: Path, out: Path, settings_of: SettingsOf) -> int:
    metadata = metadata_of(path)
    features = features_of(path, settings_of(metadata))
    return (write_kml if out.suffix == ".kml" else write_geojson)(features, title_of(metadata), out)


def _table(path: Path, out: Path, _: SettingsOf) -> int:
    require(str(out), "sim")
    from guidance.log.table import write_table  # noqa: PLC0415 - pyarrow is of an extra

    return write_table(path, out)


EXPORTS: Final[Mapping[str, tuple[str, Callable[[Path, Path, SettingsOf], int]]]] = {
    ".tlog": ("frames", lambda path, out, _: write_tlog(path, out)),
    ".csv": ("cycles", _table),
    ".parquet": ("cycles", _table),
    ".geojson": ("features", _map),
    ".kml": ("features", _map),
}


def export(path: Path, out: Path, settings_of: SettingsOf) -> str:
    """Write `out` in the format of its ending; return the count and unit written, for example "12 frames".

    Raises:
        ConfigError: If the ending is unknown, or the record cannot be read.
        OutputError: If `out` cannot be written.
    """
    if out.suffix not in EXPORTS:
        raise ConfigError(f"{out}: must end in {', '.join(EXPORTS)}")
    what, write = EXPORTS[out.suffix]
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        return f"{write(path, out, settings_of)} {what}"


def write_tlog(path: Path, out: Path) -> int:
    """Write the raw frames of both directions and all vehicles, oldest first; return their number.

    Raises:
        ConfigError: If the record cannot be read.
        OSError: If `out` cannot be written.
    """
    survey, count = Survey(), 0
    with out.open("wb") as stream:
        for now_s, frame in _ordered(_frames(path, survey)):
            stream.write(struct.pack(">Q", max(0, round((now_s + started_unix_s(survey)) * 1e6))) + frame)
            count += 1
    return count


def started_unix_s(survey: Survey) -> float:
    """Return the Unix time of the record clock's zero; 0 if unknown."""
    try:
        return datetime.fromisoformat(survey.metadata.get("started_utc", "")).timestamp()
    except ValueError:
        return 0.0


def _frames(path: Path, survey: Survey) -> Iterator[tuple[float, bytes]]:
    readers: dict[str, FrameReader] = {}
    for item in scan(path, survey):
        if item.encoding != ENCODING:
            continue
        if len(item.data) >= 8 and frame_length(item.data) == len(item.data):
            yield item.now_s, item.data
        else:  # a piece of a byte stream
            # A log keeps the messages of every dialect.
            reader = readers.setdefault(item.topic, FrameReader(dialect=dialect))
            yield from ((item.now_s, frame.data) for frame in reader.read(item.data))


def _ordered(frames: Iterator[tuple[float, bytes]]) -> Iterator[tuple[float, bytes]]:
    """Sort the frames by time; of two with the same time the first recorded is first."""
    waiting: list[tuple[float, int, bytes]] = []
    for number, (now_s, frame) in enumerate(frames):
        heapq.heappush(waiting, (now_s, number, frame))
        while waiting[0][0] < now_s - _REORDER_S:
            first_s, _, first = heapq.heappop(waiting)
            yield first_s, first
    yield from ((now_s, frame) for now_s, _, frame in sorted(waiting))


def features_of(path: Path, settings: FlightSettings) -> list[Feature]:
    """Return the features of a record; the settings give the fence and the goal.

    Raises:
        ConfigError: If the record cannot be read.
    """
    tracks: dict[str, list[GlobalPosition | EvaderReport]] = {"pursuer": []}
    changes: list[Feature] = []
    vehicle, home = VehicleState(), None
    state = ""
    for row in cycles_of(path):
        inputs = row.inputs
        tracks["pursuer"] += [one for one in inputs.messages if isinstance(one, GlobalPosition)]
        vehicle = observe(vehicle, inputs.messages)
        if vehicle.armed or home is None:  # home in flight; on the ground it drifts
            home = vehicle.last(Home)
        for report in inputs.reports:
            tracks.setdefault(f"evader ({report.source})", []).append(report)
        if row.state != state and tracks["pursuer"]:
            state = row.state
            changes.append(Feature(state, "Point", [_place(tracks["pursuer"][-1])], {"time_s": row.now_s}))
    drawn = [
        Feature(name, "LineString", [*map(_place, track)], {"times_s": [round(one.received_s, 3) for one in track]})
        for name, track in tracks.items()
        if len(track) > 1
    ]
    return [*drawn, *changes, *_fence(settings, home), *_goal(settings)]


def _fence(settings: FlightSettings, home: Home | None) -> Iterator[Feature]:
    """Draw the fence at the altitude of home."""
    if home is None:
        return
    envelope, corners_deg = settings.cycle.envelope, settings.limits.fence_polygon_deg
    place = home.latitude_deg, home.longitude_deg, Amsl(home.altitude_amsl_m)
    frame = LocalFrame(*place, projection=settings.autopilot.projection)
    radius_m, polygon = envelope.fence_radius_m, envelope.fence_polygon
    if radius_m is not None:
        turns = [2.0 * math.pi * corner / _CIRCLE_CORNERS for corner in range(_CIRCLE_CORNERS)]
        corners_ne_m = [(radius_m * math.sin(turn), radius_m * math.cos(turn)) for turn in turns]
        yield _area("fence", frame, corners_ne_m, {"radius_m": radius_m})
    if corners_deg is not None:
        polygon = polygon_about_home(corners_deg, (0.0, 0.0, 0.0), frame)
    if polygon is not None:
        yield _area("fence, polygon", frame, polygon.corners_ne_m, {})


def _goal(settings: FlightSettings) -> Iterator[Feature]:
    target_m, site = settings.cycle.target_game_m, settings.cycle.site
    if target_m is not None and site is not None:
        frame = LocalFrame(*site, projection=settings.autopilot.projection)
        yield Feature("target T", "Point", [_placed(frame, target_m[1], target_m[0])])


def _area(
    name: str, frame: LocalFrame, corners_ne_m: Sequence[tuple[float, float]], properties: Mapping[str, Any]
) -> Feature:
    """Return a closed edge, anticlockwise as RFC 7946 requires."""
    corners = [_placed(frame, north_m, east_m) for north_m, east_m in corners_ne_m]
    closed = [*corners, corners[0]]
    turning = sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(closed))
    return Feature(name, "Polygon", closed if turning > 0.0 else closed[::-1], properties)


def _placed(frame: LocalFrame, north_m: float, east_m: float) -> Coordinates:
    latitude_deg, longitude_deg, amsl = frame.wgs84_from_ned((north_m, east_m, 0.0))
    return (longitude_deg, latitude_deg, amsl.metres)


def _place(report: GlobalPosition | EvaderReport) -> Coordinates:
    return (report.longitude_deg, report.latitude_deg, report.altitude_amsl_m)


def write_geojson(features: Sequence[Feature], title: str, out: Path) -> int:
    """Write a FeatureCollection; return the number of features.

    Raises:
        OSError: If `out` cannot be written.
    """
    collection = {"type": "FeatureCollection", "name": title, "features": [_geojson(feature) for feature in features]}
    out.write_text(json.dumps(collection, allow_nan=False) + "\n", encoding="utf-8")
    return len(features)


def write_kml(features: Sequence[Feature], title: str, out: Path) -> int:
    """Write a KML document; return the number of placemarks.

    Raises:
        OSError: If `out` cannot be written.
    """
    styles = "\n".join(
        f'<Style id="{name}"><LineStyle><color>{colour}</color><width>2</width></LineStyle></Style>'
        for name, colour in _COLOURS.items()
    )
    marks = "\n".join(_placemark(feature) for feature in features)
    out.write_text(
        '<?xml version="1.0" encoding="utf-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n'
        f"<name>{_xml(title)}</name>\n{styles}\n{marks}\n</Document></kml>\n",
        encoding="utf-8",
    )
    return len(features)


def _geojson(feature: Feature) -> dict[str, Any]:
    line = [_rounded(place) for place in feature.places]
    coordinates = {"LineString": line, "Point": line[0], "Polygon": [line]}[feature.shape]
    return {
        "type": "Feature",
        "properties": {"name": feature.name, **feature.properties},
        "geometry": {"type": feature.shape, "coordinates": coordinates},
    }


def _placemark(feature: Feature) -> str:
    kind, time_s = feature.shape, feature.properties.get("time_s")
    places = " ".join(",".join(map(str, _rounded(place))) for place in feature.places)
    shape = f"<coordinates>{places}</coordinates>"
    if kind == "Polygon":
        shape = f"<outerBoundaryIs><LinearRing>{shape}</LinearRing></outerBoundaryIs>"
    else:
        shape = f"<altitudeMode>absolute</altitudeMode>{shape}"
    note = "" if time_s is None else f"<description>{time_s:.2f} s</description>"
    style = "".join(f"<styleUrl>#{name}</styleUrl>" for name in _COLOURS if feature.name.startswith(name))
    return f"<Placemark><name>{_xml(feature.name)}</name>{note}{style}<{kind}>{shape}</{kind}></Placemark>"


def _xml(text: str) -> str:
    """Escape text from a record; XML allows no control characters."""
    return escape("".join(one for one in text if one.isprintable()))


def _rounded(place: Coordinates) -> list[float]:
    """Round to 1e-8 degrees and to millimetres; an unknown altitude is left out."""
    longitude_deg, latitude_deg, altitude_m = place
    flat = [round(longitude_deg, 8), round(latitude_deg, 8)]
    return [*flat, round(altitude_m, 3)] if math.isfinite(altitude_m) else flat
