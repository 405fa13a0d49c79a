"""The map of a record: tracks, places where the state changed, fence and goal, as GeoJSON (RFC 7946) and as KML 2.2.

Altitudes are above mean sea level in both. RFC 7946 would have heights above the ellipsoid; autopilots report mean sea
level, and most viewers take it for that.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree

from guidance.flight import FlightSettings
from guidance.frames import Amsl, LocalFrame
from guidance.log.reader import cycles_of
from guidance.messages import GlobalPosition, Home
from guidance.vehicle import VehicleState, observe

Coordinates = tuple[float, float, float]
"""Longitude and latitude in degrees, altitude above mean sea level in metres."""

_CIRCLE_CORNERS = 72

_KML: Final = "http://www.opengis.net/kml/2.2"
_GEOMETRY: Final = {"track": "LineString", "place": "Point", "area": "Polygon"}
_COLOURS: Final = {"pursuer": "ff2d27c1", "evader": "ffa55f0b", "fence": "ff404040"}  # KML: alpha, blue, green, red


class Feature(NamedTuple):
    """One thing on the map: a track of many places, a single place, or an area by its closed edge."""

    name: str
    shape: str
    places: tuple[Coordinates, ...]
    properties: Mapping[str, Any]


def features_of(path: Path, settings: FlightSettings | None) -> list[Feature]:
    """Gather what a map shows.

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
        if vehicle.armed or home is None:  # where it was in flight; on the ground it wanders
            home = vehicle.last(Home)
        for report in inputs.reports:
            tracks.setdefault(f"evader ({report.source})", []).append((report.received_s, _place(report)))
        if row.state != state and tracks["pursuer"]:
            state = row.state
            changes.append(Feature(state, "place", (tracks["pursuer"][-1][1],), {"time_s": row.now_s}))
    drawn = [_track(name, track) for name, track in tracks.items() if len(track) > 1]
    return [*drawn, *changes, *(_around(settings, home) if settings is not None else ())]


def _track(name: str, track: list[tuple[float, Coordinates]]) -> Feature:
    times_s = [round(now_s, 3) for now_s, _ in track]
    return Feature(name, "track", tuple(place for _, place in track), {"times_s": times_s})


def _around(settings: FlightSettings, home: Home | None) -> list[Feature]:
    features = [] if home is None else list(_fence(settings, home))
    site = settings.cycle.site
    if settings.cycle.target_game_m is not None and site is not None:
        frame = LocalFrame(*site, projection=settings.autopilot.projection)
        x, y, _ = settings.cycle.target_game_m
        latitude_deg, longitude_deg, amsl = frame.wgs84_from_ned((y, x, 0.0))
        features.append(Feature("target T", "place", ((longitude_deg, latitude_deg, amsl.metres),), {}))
    return features


def _fence(settings: FlightSettings, home: Home) -> Iterator[Feature]:
    """Every edge of the fence, at home's height."""
    envelope, altitude_m = settings.cycle.envelope, home.altitude_amsl_m
    frame = LocalFrame(
        home.latitude_deg, home.longitude_deg, Amsl(altitude_m), projection=settings.autopilot.projection
    )
    if envelope.fence_radius_m is not None:
        edge = tuple(_on_circle(frame, envelope.fence_radius_m, corner) for corner in range(_CIRCLE_CORNERS))
        yield Feature("fence", "area", (*edge, edge[0]), {"radius_m": envelope.fence_radius_m})
    if settings.limits.fence_polygon_deg is not None:
        yield _polygon([(longitude, latitude, altitude_m) for latitude, longitude in settings.limits.fence_polygon_deg])
    elif envelope.fence_polygon is not None:
        yield _polygon([_placed(frame, north_m, east_m) for north_m, east_m in envelope.fence_polygon.corners_ne_m])


def _polygon(corners: list[Coordinates]) -> Feature:
    """A closed edge, anticlockwise as RFC 7946 wants an outer one."""
    closed = [*corners, corners[0]]
    turning = sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(closed))
    return Feature("fence, polygon", "area", tuple(closed if turning > 0.0 else reversed(closed)), {})


def _on_circle(frame: LocalFrame, radius_m: float, corner: int) -> Coordinates:
    """A corner of the circle, counted anticlockwise as RFC 7946 wants an outer edge."""
    angle = 2.0 * math.pi * corner / _CIRCLE_CORNERS
    return _placed(frame, radius_m * math.sin(angle), radius_m * math.cos(angle))


def _placed(frame: LocalFrame, north_m: float, east_m: float) -> Coordinates:
    latitude_deg, longitude_deg, amsl = frame.wgs84_from_ned((north_m, east_m, 0.0))
    return (longitude_deg, latitude_deg, amsl.metres)


def _place(said: Any) -> Coordinates:  # noqa: ANN401 - a GlobalPosition or an EvaderReport
    return (said.longitude_deg, said.latitude_deg, said.altitude_amsl_m)


def write_geojson(features: Sequence[Feature], title: str, out: Path) -> int:
    """Write a FeatureCollection; return how many features.

    Raises:
        OSError: If `out` cannot be written.
    """
    collection = {"type": "FeatureCollection", "name": title, "features": [_geojson(feature) for feature in features]}
    out.write_text(json.dumps(collection, allow_nan=False) + "\n", encoding="utf-8")
    return len(features)


def write_kml(features: Sequence[Feature], title: str, out: Path) -> int:
    """Write a KML document; return how many placemarks.

    Raises:
        OSError: If `out` cannot be written.
    """
    ElementTree.register_namespace("", _KML)
    root = ElementTree.Element(f"{{{_KML}}}kml")
    document = _add(root, "Document")
    _add(document, "name", title)
    for name, colour in _COLOURS.items():
        style = _add(document, "Style")
        style.set("id", name)
        line = _add(style, "LineStyle")
        _add(line, "color", colour)
        _add(line, "width", "2")
    for feature in features:
        _placemark(document, feature)
    ElementTree.ElementTree(root).write(out, encoding="utf-8", xml_declaration=True)
    return len(features)


def _geojson(feature: Feature) -> dict[str, Any]:
    line = [_rounded(place) for place in feature.places]
    coordinates = {"track": line, "place": line[0], "area": [line]}[feature.shape]
    return {
        "type": "Feature",
        "properties": {"name": feature.name, **feature.properties},
        "geometry": {"type": _GEOMETRY[feature.shape], "coordinates": coordinates},
    }


def _placemark(document: ElementTree.Element, feature: Feature) -> None:
    mark = _add(document, "Placemark")
    _add(mark, "name", feature.name)
    if "time_s" in feature.properties:
        _add(mark, "description", f"{feature.properties['time_s']:.2f} s")
    style = next((name for name in _COLOURS if feature.name.startswith(name)), None)
    if style is not None:
        _add(mark, "styleUrl", f"#{style}")
    shape = _add(mark, _GEOMETRY[feature.shape])
    if feature.shape == "area":
        shape = _add(_add(shape, "outerBoundaryIs"), "LinearRing")
    else:
        _add(shape, "altitudeMode", "absolute")
    _add(shape, "coordinates", " ".join(",".join(map(str, _rounded(place))) for place in feature.places))


def _add(parent: ElementTree.Element, name: str, text: str | None = None) -> ElementTree.Element:
    child = ElementTree.SubElement(parent, f"{{{_KML}}}{name}")
    child.text = text
    return child


def _rounded(place: Coordinates) -> list[float]:
    """A centimetre is 1e-7 degrees; an altitude that is not known is left out."""
    longitude_deg, latitude_deg, altitude_m = place
    flat = [round(longitude_deg, 8), round(latitude_deg, 8)]
    return [*flat, round(altitude_m, 3)] if math.isfinite(altitude_m) else flat
