"""Cuts lines and rings of a map at the date line, as RFC 7946, section 3.1.9, asks.

A map program joins 179.9° and −179.9° by a line around the whole Earth. So a shape across the date line becomes
several, each within −180° to 180°. Places are (longitude in degrees, latitude in degrees, altitude in metres).
"""

import math
from collections.abc import Sequence
from itertools import pairwise

Coordinates = tuple[float, float, float]
"""Longitude and latitude in degrees, altitude above mean sea level in metres."""


def unwrapped(places: Sequence[Coordinates]) -> list[Coordinates]:
    """Return the places with longitudes that never jump by more than 180°, so that they may leave −180° to 180°."""
    continuous: list[Coordinates] = []
    for longitude_deg, latitude_deg, altitude_m in places:
        if continuous:
            turns = round((continuous[-1][0] - longitude_deg) / 360.0)
            longitude_deg += 360.0 * turns  # noqa: PLW2901 - the same place
        continuous.append((longitude_deg, latitude_deg, altitude_m))
    return continuous


def cut_line(places: Sequence[Coordinates]) -> list[list[Coordinates]]:
    """Return the pieces of a line, each within −180° to 180°."""
    continuous = unwrapped(places)
    pieces: list[list[Coordinates]] = [continuous[:1]]
    for before, after in pairwise(continuous):
        # A line crosses a date line at most once, because it is shorter than half the Earth.
        first = _turns(before[0])
        second = _turns(after[0])
        if first != second:
            crossing = _at_longitude(before, after, 360.0 * max(first, second) - 180.0)
            pieces[-1].append(crossing)
            pieces.append([crossing])
        pieces[-1].append(after)
    return [_shifted(piece) for piece in pieces]


def cut_ring(ring: Sequence[Coordinates]) -> list[list[Coordinates]]:
    """Return the pieces of a closed ring, each closed, anticlockwise and within −180° to 180°."""
    continuous = unwrapped(ring)
    if not _area(continuous) > 0.0:
        continuous.reverse()
    first = _turns(min(coordinates[0] for coordinates in continuous))
    last = _turns(max(coordinates[0] for coordinates in continuous))
    pieces = []
    for turns in range(first, last + 1):
        west_deg = 360.0 * turns - 180.0
        piece = _beyond(_beyond(continuous, west_deg, side=1.0), west_deg + 360.0, side=-1.0)
        if _area(piece) > 0.0:
            pieces.append(_shifted(piece))
    return pieces


def _turns(longitude_deg: float) -> int:
    """Return the number of a longitude's turn around the Earth: 0 within −180° to 180°."""
    return math.floor((longitude_deg + 180.0) / 360.0)


def _at_longitude(before: Coordinates, after: Coordinates, longitude_deg: float) -> Coordinates:
    """Return the place between two at a longitude."""
    share = (longitude_deg - before[0]) / (after[0] - before[0])
    latitude_deg = before[1] + share * (after[1] - before[1])
    altitude_m = before[2] + share * (after[2] - before[2])
    return longitude_deg, latitude_deg, altitude_m


def _shifted(piece: Sequence[Coordinates]) -> list[Coordinates]:
    """Return a piece that lies within one turn, moved to −180° to 180°."""
    middle_deg = 0.5 * (
        min(coordinates[0] for coordinates in piece) + max(coordinates[0] for coordinates in piece)
    )
    shift_deg = 360.0 * _turns(middle_deg)
    return [(longitude - shift_deg, latitude, altitude) for longitude, latitude, altitude in piece]


def _beyond(ring: Sequence[Coordinates], longitude_deg: float, *, side: float) -> list[Coordinates]:
    """Return the part of a closed ring east (side 1) or west (side −1) of a longitude, closed."""
    part: list[Coordinates] = []
    for before, after in pairwise(ring):
        before_in = side * (before[0] - longitude_deg) >= 0.0
        after_in = side * (after[0] - longitude_deg) >= 0.0
        if before_in:
            part.append(before)
        if before_in != after_in:
            part.append(_at_longitude(before, after, longitude_deg))
    return [*part, *part[:1]]


def _area(ring: Sequence[Coordinates]) -> float:
    """Return twice the signed area of a closed ring, degrees²; positive if it is anticlockwise."""
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(ring))
