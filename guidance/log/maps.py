"""Exports a record as a map: tracks, state changes, fence and goal, as GeoJSON (RFC 7946) or KML 2.2.

Altitudes are above mean sea level in both. RFC 7946 asks for heights above the ellipsoid, but autopilots report mean
sea level and most viewers expect it.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.sax.saxutils import escape

from guidance.flight import FlightSettings
from guidance.frames import Amsl, LocalFrame
from guidance.log.reader import cycles_of
from guidance.messages import EvaderReport, GlobalPosition, Home
from guidance.vehicle import VehicleState, observe

Coordinates = tuple[float, float, float]
"""Longitude and latitude in degrees, altitude above mean sea level in metres."""

_CIRCLE_CORNERS: Final = 72
_GEOMETRY: Final = {"track": "LineString", "place": "Point", "area": "Polygon"}
_COLOURS: Final = {"pursuer": "ff2d27c1", "evader": "ffa55f0b", "fence": "ff404040"}  # KML: alpha, blue, green, red


class Feature(NamedTuple):
    """One shape on the map: a track, a single place, or an area given by its closed edge."""

    name: str
    shape: str
    places: tuple[Coordinates, ...]
    properties: Mapping[str, Any]


def features_of(path: Path, settings: FlightSettings | None) -> list[Feature]:
    """Return the features of a record.

    Args:
        path: The record.
        settings: The flight's, for the fence and the goal; None leaves both out.

    Raises:
        ConfigError: If the record cannot be read.
    """
    tracks: dict[str, list[tuple[float, Coordinates]]] = {"pursuer": []}
    changes: list[Feature] = []
    vehicle, home = VehicleState(), None
    state = ""
    for row in cycles_of(path):
        inputs = row.inputs
        for message in inputs.messages:
            if isinstance(message, GlobalPosition):
                tracks["pursuer"].append((message.received_s, _place(message)))
        vehicle = observe(vehicle, inputs.messages)
        if vehicle.armed or home is None:  # home in flight; on the ground it drifts
            home = vehicle.last(Home)
        for report in inputs.reports:
            tracks.setdefault(f"evader ({report.source})", []).append((report.received_s, _place(report)))
        if row.state != state and tracks["pursuer"]:
            state = row.state
            changes.append(Feature(state, "place", (tracks["pursuer"][-1][1],), {"time_s": row.now_s}))
    drawn = [_track(name, track) for name, track in tracks.items() if len(track) > 1]
    return [*drawn, *changes, *(() if settings is None else _fence_and_goal(settings, home))]


def _track(name: str, track: list[tuple[float, Coordinates]]) -> Feature:
    times_s = [round(now_s, 3) for now_s, _ in track]
    return Feature(name, "track", tuple(place for _, place in track), {"times_s": times_s})


def _fence_and_goal(settings: FlightSettings, home: Home | None) -> Iterator[Feature]:
    """The fence is drawn at the altitude of home."""
    envelope, projection = settings.cycle.envelope, settings.autopilot.projection
    if home is not None:
        frame = LocalFrame(home.latitude_deg, home.longitude_deg, Amsl(home.altitude_amsl_m), projection=projection)
        radius_m = envelope.fence_radius_m
        if radius_m is not None:
            turns = (2.0 * math.pi * corner / _CIRCLE_CORNERS for corner in range(_CIRCLE_CORNERS))
            corners = [_placed(frame, radius_m * math.sin(turn), radius_m * math.cos(turn)) for turn in turns]
            yield _area("fence", corners, {"radius_m": radius_m})
        corners_deg = settings.limits.fence_polygon_deg
        if corners_deg is not None:
            corners = [(longitude, latitude, home.altitude_amsl_m) for latitude, longitude in corners_deg]
            yield _area("fence, polygon", corners, {})
        elif envelope.fence_polygon is not None:
            corners = [_placed(frame, north_m, east_m) for north_m, east_m in envelope.fence_polygon.corners_ne_m]
            yield _area("fence, polygon", corners, {})
    site = settings.cycle.site
    if settings.cycle.target_game_m is not None and site is not None:
        x, y, _ = settings.cycle.target_game_m
        yield Feature("target T", "place", (_placed(LocalFrame(*site, projection=projection), y, x),), {})


def _area(name: str, corners: list[Coordinates], properties: Mapping[str, Any]) -> Feature:
    """A closed edge, anticlockwise as RFC 7946 requires."""
    closed = [*corners, corners[0]]
    turning = sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(closed))
    return Feature(name, "area", tuple(closed if turning > 0.0 else reversed(closed)), properties)


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
    coordinates = {"track": line, "place": line[0], "area": [line]}[feature.shape]
    return {
        "type": "Feature",
        "properties": {"name": feature.name, **feature.properties},
        "geometry": {"type": _GEOMETRY[feature.shape], "coordinates": coordinates},
    }


def _placemark(feature: Feature) -> str:
    places = " ".join(",".join(map(str, _rounded(place))) for place in feature.places)
    shape = f"<coordinates>{places}</coordinates>"
    if feature.shape == "area":
        shape = f"<outerBoundaryIs><LinearRing>{shape}</LinearRing></outerBoundaryIs>"
    else:
        shape = f"<altitudeMode>absolute</altitudeMode>{shape}"
    time_s = feature.properties.get("time_s")
    note = "" if time_s is None else f"<description>{time_s:.2f} s</description>"
    style = "".join(f"<styleUrl>#{name}</styleUrl>" for name in _COLOURS if feature.name.startswith(name))
    kind = _GEOMETRY[feature.shape]
    return f"<Placemark><name>{_xml(feature.name)}</name>{note}{style}<{kind}>{shape}</{kind}></Placemark>"


def _xml(text: str) -> str:
    """Escape text from a record; XML allows no control characters."""
    return escape("".join(one for one in text if one.isprintable()))


def _rounded(place: Coordinates) -> list[float]:
    """Round to 1e-8 degrees and to millimetres; an unknown altitude is left out."""
    longitude_deg, latitude_deg, altitude_m = place
    flat = [round(longitude_deg, 8), round(latitude_deg, 8)]
    return [*flat, round(altitude_m, 3)] if math.isfinite(altitude_m) else flat
