"""Shapes around a flight as arrays in the game frame (m, x east, y north): discs, isochrons, the fence."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from guidance.certificate import Certificate
from guidance.control import Envelope
from guidance.cycle import CycleSettings, game_played
from guidance.frames import Vector
from guidance.game import Extent, Game, solve

Array = NDArray[np.float64]


def circle(centre: Vector, radius_m: float, points: int = 181) -> Array:
    """A closed circle (points, 2), seen from above."""
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    return np.stack([centre[0] + radius_m * np.cos(angle), centre[1] + radius_m * np.sin(angle)], axis=-1)


def target_edge(place_m: Vector, extent: Extent) -> Array:
    """The closed edge (n, 2) of a target's shape about its place; of a point nothing."""
    edge = np.array(extent.outline_m()).reshape(-1, 2) + np.array(place_m[:2])
    return np.concatenate([edge, edge[:1]])


def isochron(game: Game, pursuer_m: Vector, evader_m: Vector, points: int = 181) -> Array:
    """Capture points (points, 2) of an evader that runs straight at full speed, one for each heading, m.

    The paper's Apollonius circle for a Ball and point capture. Found from the game itself: TAD towards a far target in
    each heading ends where that heading's run ends.

    Args:
        game: The game.
        pursuer_m: P, m.
        evader_m: E, m.
        points: How many headings.
    """
    headings = np.linspace(0.0, 2.0 * np.pi, points)
    far = 1e6 * np.stack([np.cos(headings), np.sin(headings), np.zeros(points)], axis=-1)
    P = np.broadcast_to(np.array(pursuer_m), (points, 3)).copy()
    E = np.broadcast_to(np.array(evader_m), (points, 3)).copy()
    return np.asarray(solve(game, P, E, E + far).meeting_point_m[:, :2])


def isochron_at(settings: CycleSettings, certificate: Certificate, points: int = 181) -> Array:
    """The isochron (points, 2) of the cycle's game. It contains the meeting point."""
    bound_m_s = float(settings.speed_set.horizontal_m_s) / certificate.speed_ratio
    game, _ = game_played(settings, bound_m_s, certificate.evader_age_s)
    game = replace(game, target_velocity_m_s=(0.0, 0.0))  # a straight run does not depend on the target
    return isochron(game, certificate.pursuer_game_m, certificate.evader_game_m, points)


def fence_edges(envelope: Envelope, home_m: Vector) -> list[Array]:
    """The fence's edges as closed curves (n, 2)."""
    edges = []
    if envelope.fence_radius_m is not None:
        edges.append(circle(home_m, envelope.fence_radius_m))
    if envelope.fence_polygon is not None:
        corners = np.array(envelope.fence_polygon.corners_ne_m)[:, ::-1] + np.array(home_m[:2])  # north, east of home
        edges.append(np.concatenate([corners, corners[:1]]))
    return edges
