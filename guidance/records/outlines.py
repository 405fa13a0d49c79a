"""What is drawn around a flight, in the game frame (m, x east, y north): the fence, the isochron, circles."""

import numpy as np
from numpy.typing import NDArray

from guidance.frames import Vector
from guidance.game import Game
from guidance.limits import Envelope
from guidance.scenarios.picture import isochron
from guidance.tick import Certificate, TickSettings

Array = NDArray[np.float64]


def circle(centre: Vector, radius_m: float, points: int = 181) -> Array:
    """A closed circle (points, 2), seen from above."""
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    return np.stack([centre[0] + radius_m * np.cos(angle), centre[1] + radius_m * np.sin(angle)], axis=-1)


def fence_edges(envelope: Envelope, home_m: Vector) -> list[Array]:
    """Every edge of the fence about home as a closed curve (n, 2); none where there is no fence."""
    edges = []
    if envelope.fence_radius_m is not None:
        edges.append(circle(home_m, envelope.fence_radius_m))
    if envelope.fence_polygon is not None:
        corners = np.array(envelope.fence_polygon.corners_ne_m)[:, ::-1] + np.array(home_m[:2])  # north, east of home
        edges.append(np.concatenate([corners, corners[:1]]))
    return edges


def isochron_at(tick: TickSettings, certificate: Certificate, points: int = 181) -> Array:
    """Where an evader that runs straight is caught, by heading (points, 2), from where both are at this cycle."""
    game = Game(tick.speed_set, tick.declared_evader_speed_m_s, standoff=tick.standoff)
    return isochron(game, certificate.pursuer_game_m, certificate.evader_game_m, points)
