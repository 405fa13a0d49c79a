"""Exports a record in the format that the ending of the output file selects.

A .tlog is the telemetry log of QGroundControl, Mission Planner and pymavlink's mavlogdump. Each frame follows 8 bytes
with its time in microseconds since 1970, big-endian. Records in virtual time have no UTC start and begin in 1970.

A table has one row per cycle, with units in the column names.

A map has tracks, state changes, fence and goal, as GeoJSON (RFC 7946) or KML 2.2. Altitudes are above mean sea level in
both. RFC 7946 asks for heights above the ellipsoid, but autopilots report mean sea level and most viewers expect it.
"""

import csv
import heapq
import json
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import Any, Final, get_type_hints
from xml.sax.saxutils import escape

from pymavlink.dialects.v20 import all as dialect

from guidance import messages
from guidance.cycle import Certificate
from guidance.errors import ConfigError
from guidance.extras import require_extras
from guidance.files import private_folder, whole_file, writing
from guidance.flight import BEFORE_FLIGHT, FlightSettings
from guidance.flight.tracking import NOWHERE
from guidance.frames import Amsl, LocalFrame, Ned, game_from_ned
from guidance.links.mavlink.frames import FrameReader, frame_length
from guidance.log.aggregator import SettingsOf
from guidance.log.codec import inside
from guidance.log.date_line import Coordinates, cut_line, cut_ring
from guidance.log.entries import title_of
from guidance.log.reader import Survey, cycles_of, metadata_of, scan
from guidance.log.scene import fence_edges
from guidance.messages import AltitudeSaid, EvaderReport, GlobalPosition, Home, Setpoint
from guidance.vehicle import VehicleState, observe

EXPORTS: Final = (".tlog", ".csv", ".parquet", ".geojson", ".kml")
_REORDER_S: Final = 1.0
"""Frames are recorded vehicle by vehicle each cycle, so times within this window may be out of order."""

_AXES: Final = {"_ned": ("north", "east", "down"), "_game": ("east", "north", "up")}
_EVADER: Final = (
    "received_s sent_s source latitude_deg longitude_deg altitude_amsl_m velocity_ned_m_s"
)
_EXPORTED: Final[tuple[tuple[str, type, str], ...]] = (
    ("vehicle_", messages.LocalPosition, "position_ned_m velocity_ned_m_s"),
    (
        "vehicle_",
        GlobalPosition,
        "latitude_deg longitude_deg altitude_amsl_m altitude_above_home_m",
    ),
    ("vehicle_", messages.Attitude, "yaw_rad"),
    ("vehicle_", messages.Heartbeat, "custom_mode armed"),
    ("vehicle_", messages.SystemStatus, "battery_remaining"),
    ("evader_", EvaderReport, _EVADER),
    ("evader_said_", AltitudeSaid, " ".join(AltitudeSaid._fields)),
    ("setpoint_", Setpoint, " ".join(Setpoint._fields)),
    ("game_", Certificate, " ".join(Certificate._fields)),
)
"""Column prefix, type of the message, and its exported fields."""

# KML: alpha, blue, green, red
_COLOURS: Final = {
    "pursuer": "ff2d27c1",
    "evader": "ffa55f0b",
    "fence": "ff404040",
}

Feature = dict[str, Any]
"""One shape on the map, as GeoJSON."""


def export(path: Path, out: Path, settings_of: SettingsOf) -> str:
    """Write `out` in the format of its ending; return the count and unit written, for example "12 frames".

    Raises:
        ConfigError: If the ending is unknown, or the record cannot be read.
        OutputError: If `out` cannot be written.
    """
    if out.suffix not in EXPORTS:
        endings = ", ".join(EXPORTS)
        raise ConfigError(
            f"{out}: must end in {endings}, or have no ending: a folder for a ROS 2 bag"
        )
    with writing(out):
        private_folder(out.parent)
        with whole_file(out) as unfinished:
            if out.suffix == ".tlog":
                return f"{write_tlog(path, unfinished)} frames"
            if out.suffix == ".csv":
                return f"{write_csv(path, unfinished)} cycles"
            if out.suffix == ".parquet":
                return f"{write_parquet(path, unfinished)} cycles"
            metadata = metadata_of(path)
            features = features_of(path, settings_of(metadata))
            document = kml if out.suffix == ".kml" else geojson
            text = document(features, title_of(metadata))
            unfinished.write_text(text + "\n", encoding="utf-8")
            return f"{len(features)} features"


def write_tlog(path: Path, out: Path) -> int:
    """Write the raw frames of both directions and all vehicles, oldest first; return their number.

    Raises:
        ConfigError: If the record cannot be read.
        OSError: If `out` cannot be written.
    """
    survey = Survey()
    count = 0
    with out.open("wb") as stream:
        for now_s, frame in _ordered(_frames(path, survey)):
            stream.write(
                struct.pack(">Q", max(0, round((now_s + started_unix_s(survey.metadata)) * 1e6)))
                + frame
            )
            count += 1
    return count


def started_unix_s(metadata: Mapping[str, str]) -> float:
    """Return the Unix time of the record clock's zero; 0 if unknown."""
    try:
        return datetime.fromisoformat(metadata.get("started_utc", "")).timestamp()
    except ValueError:
        return 0.0


def _frames(path: Path, survey: Survey) -> Iterator[tuple[float, bytes]]:
    readers: dict[str, FrameReader] = {}
    for item in scan(path, survey):
        if item.encoding != "mavlink":
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
    vehicle = VehicleState()
    home = None
    state = ""
    for row in cycles_of(path):
        inputs = row.inputs
        tracks["pursuer"] += [
            message for message in inputs.messages if isinstance(message, GlobalPosition)
        ]
        vehicle = observe(vehicle, inputs.messages)
        # As the flight itself does; on the ground home drifts
        if row.state not in BEFORE_FLIGHT and vehicle.latest.get(Home) is not None:
            vehicle = vehicle._replace(home_fixed=True)
        home = vehicle.latest.get(Home)
        for report in inputs.reports:
            tracks.setdefault(f"evader ({report.source})", []).append(report)
        if row.state != state and tracks["pursuer"]:
            state = row.state
            changes.append(
                feature(
                    state, "Point", [_reported_coordinates(tracks["pursuer"][-1])], time_s=row.now_s
                )
            )
    drawn = []
    for name, track in ((name, track) for name, track in tracks.items() if len(track) > 1):
        times_s = [round(report.received_s, 3) for report in track]
        drawn.append(
            feature(name, "LineString", [*map(_reported_coordinates, track)], times_s=times_s)
        )
    target_features = []
    target_m = settings.cycle.target_game_m
    site = settings.cycle.site
    if target_m is not None and site is not None:
        frame = LocalFrame(*site, projection=settings.autopilot.projection)
        target_features.append(
            feature("target T", "Point", [_coordinates(frame, target_m[1], target_m[0])])
        )
    # The fence at the altitude of home.
    fence_features = []
    if home is not None:
        home_place = home.latitude_deg, home.longitude_deg, Amsl(home.altitude_amsl_m)
        frame = LocalFrame(*home_place, projection=settings.autopilot.projection)
        envelope = settings.limits.about_home(settings.cycle.envelope, NOWHERE, frame)
        for edge in fence_edges(envelope, game_from_ned(NOWHERE)):
            places = [_coordinates(frame, north_m, east_m) for east_m, north_m, _ in edge.tolist()]
            fence_features.append(feature("fence", "Polygon", places))
    return [*drawn, *changes, *fence_features, *target_features]


def _coordinates(frame: LocalFrame, north_m: float, east_m: float) -> Coordinates:
    latitude_deg, longitude_deg, amsl = frame.wgs84_from_ned(Ned((north_m, east_m, 0.0)))
    return (longitude_deg, latitude_deg, amsl.metres)


def _reported_coordinates(report: GlobalPosition | EvaderReport) -> Coordinates:
    return (report.longitude_deg, report.latitude_deg, report.altitude_amsl_m)


def feature(name: str, shape: str, places: Sequence[Coordinates], **properties: Any) -> Feature:  # noqa: ANN401
    """Return a feature; a Polygon is given by its closed edge.

    A LineString or Polygon across the date line becomes a MultiLineString or MultiPolygon.
    """
    if shape == "Point":
        geometry = {"type": shape, "coordinates": _rounded(places[0])}
    elif shape == "LineString":
        lines = [[*map(_rounded, piece)] for piece in cut_line(places)]
        geometry = _geometry(shape, lines)
    else:
        geometry = _geometry(shape, [[[*map(_rounded, ring)]] for ring in cut_ring(places)])
    return {"type": "Feature", "properties": {"name": name, **properties}, "geometry": geometry}


def _geometry(shape: str, pieces: Sequence[Any]) -> dict[str, Any]:
    """Return a geometry of one piece or of several."""
    if len(pieces) == 1:
        return {"type": shape, "coordinates": pieces[0]}
    return {"type": f"Multi{shape}", "coordinates": pieces}


def _rounded(place: Coordinates) -> list[float]:
    """Return a place to 1e-8 degrees and to millimetres; an unknown altitude is left out."""
    longitude_deg, latitude_deg, altitude_m = place
    flat = [round(longitude_deg, 8), round(latitude_deg, 8)]
    if math.isfinite(altitude_m):
        return [*flat, round(altitude_m, 3)]
    return flat


def geojson(features: Sequence[Feature], title: str) -> str:
    """Return a FeatureCollection."""
    return json.dumps(
        {"type": "FeatureCollection", "name": title, "features": features}, allow_nan=False
    )


def kml(features: Sequence[Feature], title: str) -> str:
    """Return a KML document with a placemark for each feature."""
    style = '<Style id="{}"><LineStyle><color>{}</color><width>2</width></LineStyle></Style>'
    styles = "\n".join(style.format(name, colour) for name, colour in _COLOURS.items())
    placemarks = "\n".join(map(_placemark, features))
    return f"""<?xml version="1.0" encoding="utf-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document>
<name>{_xml(title)}</name>
{styles}
{placemarks}
</Document></kml>"""


def _placemark(feature: Feature) -> str:
    kind = feature["geometry"]["type"]
    coordinates = feature["geometry"]["coordinates"]
    name = feature["properties"]["name"]
    time_s = feature["properties"].get("time_s")
    if kind.startswith("Multi"):
        shapes = [_kml_shape(kind.removeprefix("Multi"), piece) for piece in coordinates]
        shape = f"<MultiGeometry>{''.join(shapes)}</MultiGeometry>"
    else:
        shape = _kml_shape(kind, coordinates)
    note = "" if time_s is None else f"<description>{time_s:.2f} s</description>"
    style = "".join(
        f"<styleUrl>#{styled}</styleUrl>" for styled in _COLOURS if name.startswith(styled)
    )
    return f"<Placemark><name>{_xml(name)}</name>{note}{style}{shape}</Placemark>"


def _kml_shape(kind: str, coordinates: Any) -> str:  # noqa: ANN401 - nested as GeoJSON nests it
    """Return a Point, LineString or Polygon."""
    line = {"Point": [coordinates], "Polygon": coordinates[0]}.get(kind, coordinates)
    places = " ".join(",".join(map(str, place)) for place in line)
    shape = f"<coordinates>{places}</coordinates>"
    if kind == "Polygon":
        shape = f"<outerBoundaryIs><LinearRing>{shape}</LinearRing></outerBoundaryIs>"
    else:
        shape = f"<altitudeMode>absolute</altitudeMode>{shape}"
    return f"<{kind}>{shape}</{kind}>"


def _xml(text: str) -> str:
    """Escape text from a record; XML allows no control characters."""
    return escape("".join(letter for letter in text if letter.isprintable()))


def write_csv(path: Path, out: Path) -> int:
    """Write a row for each cycle; return their number.

    A cell is empty for NaN, before the first message, and in cycles without setpoint or game. Every number of a column
    of floats has a decimal point or an exponent, so that readers which guess types from the first rows guess right.

    Raises:
        ConfigError: If the record cannot be read.
        OSError: If `out` cannot be written.
    """
    types = _types()
    count = 0
    with out.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(types)
        for row in _rows(path):
            cells = []
            for name, kind in types.items():
                value = row.get(name)
                if value is None or value != value:  # noqa: PLR0124 - NaN
                    cells.append("")
                elif kind is bool:
                    cells.append(str(value).lower())
                else:
                    cells.append(str(float(value) if kind is float else value))
            writer.writerow(cells)
            count += 1
    return count


def write_parquet(path: Path, out: Path) -> int:
    """Write the table of `write_csv` as Parquet, with null for empty cells; return the number of rows.

    Raises:
        ConfigError: If the record cannot be read, or pyarrow is not installed.
        OSError: If `out` cannot be written.
    """
    require_extras(str(out), "sim")
    import pyarrow as pa  # noqa: PLC0415 - of an extra
    from pyarrow import parquet  # noqa: PLC0415

    arrow = {float: pa.float64(), int: pa.int64(), bool: pa.bool_()}
    schema = pa.schema([(name, arrow.get(kind, pa.string())) for name, kind in _types().items()])
    rows = _rows(path)
    count = 0
    with parquet.ParquetWriter(out, schema) as writer:
        while batch := list(islice(rows, 4096)):
            writer.write_batch(pa.RecordBatch.from_pylist(batch, schema=schema))
            count += len(batch)
    return count


def _types() -> dict[str, Any]:
    """Return the type of each column of the table."""
    named = {name: kind for _, _, names, kind in _columns() for name in names}
    return {"now_s": float, "state": str, **named, "alarm": str}


def _columns() -> Iterator[tuple[type, str, Sequence[str], Any]]:
    """Yield message type, field, names and type of the columns: three for a vector, named by its axes."""
    for prefix, kind, fields in _EXPORTED:
        for field in fields.split():
            frame = next((frame for frame in _AXES if f"{frame}_" in field), None)
            if frame is None:
                yield kind, field, [f"{prefix}{field}"], inside(get_type_hints(kind)[field])
            else:
                yield (
                    kind,
                    field,
                    [f"{prefix}{field.replace(frame, f'_{axis}')}" for axis in _AXES[frame]],
                    float,
                )


def _rows(path: Path) -> Iterator[dict[str, Any]]:
    """Yield column -> value for each cycle; a message keeps its value until the next of its type."""
    columns = list(_columns())
    latest: dict[type, Any] = {}
    for row in cycles_of(path):
        latest |= {type(message): message for message in row.inputs.messages}
        for report in row.inputs.reports:
            latest |= {EvaderReport: report, AltitudeSaid: report.said}
        latest |= {Setpoint: row.setpoint, Certificate: row.certificate}
        cells = {
            "now_s": row.now_s,
            "state": row.state,
            "alarm": None if row.alarm is None else row.alarm.words,
        }
        for kind, field, names, _ in columns:
            value = getattr(latest.get(kind), field, None)
            if len(names) > 1:
                parts = (None,) * 3 if value is None else value
                cells |= zip(names, parts, strict=True)
            else:
                cells[names[0]] = "; ".join(value) if isinstance(value, tuple) else value
        yield cells
