"""The map of a record as GeoJSON (RFC 7946) and as KML 2.2. Altitudes are above mean sea level in both.

RFC 7946 would have heights above the ellipsoid; autopilots report mean sea level, and most viewers take it for that.
"""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

from guidance.log.places import Coordinates, Feature

_KML: Final = "http://www.opengis.net/kml/2.2"
_GEOMETRY: Final = {"track": "LineString", "place": "Point", "area": "Polygon"}
_COLOURS: Final = {"pursuer": "ff2d27c1", "evader": "ffa55f0b", "fence": "ff404040"}  # KML: alpha, blue, green, red


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
