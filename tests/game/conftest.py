"""The games that the tests go through, and an oracle that knows nothing but their definition."""

from types import SimpleNamespace

import numpy as np
import pytest

from guidance.game import Ball, Cylinder, Game, StandOff

DISC = StandOff(3.0, 2.0)
GAMES = {
    "paper": Game(Ball(2.0), 1.0),
    "capture_radius": Game(Ball(2.0), 1.0, capture_radius_m=1.5),
    "age": Game(Ball(2.0), 1.0, standoff=StandOff(1.5, 0.0), information_age_s=1.0),
    "ball_standoff": Game(Ball(2.0), 1.0, standoff=DISC, capture_radius_m=0.5),
    "wind": Game(Ball(2.0), 1.0, wind_m_s=(0.3, -0.4)),
    "ball_everything": Game(
        Ball(2.0),
        1.0,
        wind_m_s=(0.3, -0.4),
        standoff=DISC,
        information_age_s=0.5,
        capture_radius_m=0.2,
    ),
    "cylinder": Game(Cylinder(2.0, 0.7, 0.5), 1.0),
    "cylinder_standoff": Game(Cylinder(2.0, 0.7, 0.5), 1.0, standoff=DISC, capture_radius_m=0.5),
    "cylinder_everything": Game(
        Cylinder(2.0, 0.7, 0.5),
        1.0,
        wind_m_s=(0.2, 0.5),
        standoff=DISC,
        information_age_s=0.5,
        capture_radius_m=0.2,
    ),
    "space": Game(Ball(2.0), 1.0, evader_space="space"),
    "space_radius_and_age": Game(
        Ball(2.0), 1.0, evader_space="space", capture_radius_m=0.5, information_age_s=0.3
    ),
}
MOVING = {
    "moving_target": Game(Ball(2.0), 1.0, target_velocity_m_s=(0.3, 0.2)),
    "moving_target_cylinder": Game(
        Cylinder(2.0, 0.7, 0.5),
        1.0,
        standoff=DISC,
        target_velocity_m_s=(0.1, -0.3),
        information_age_s=0.2,
    ),
}


@pytest.fixture(scope="session", params=GAMES)
def game(request):
    return GAMES[request.param]


@pytest.fixture(scope="session", params=[*GAMES, *MOVING])
def tad_game(request):
    return (GAMES | MOVING)[request.param]


@pytest.fixture(scope="session")
def games():
    return GAMES | MOVING


def random_states(seed, count, game=None):
    """Positions of P, E and T, (count, 3) each, P from below the disc to far above it."""
    rng = np.random.default_rng(seed)
    P, E, T = rng.uniform(-20.0, 20.0, (3, count, 3))
    P[:, 2] = rng.uniform(0.0, 20.0, count)
    if game is None or game.evader_space == "plane":
        E[:, 2] = T[:, 2] = 0.0
    return P, E, T


def shortfall(game, P, X, t):
    """Distance by which an evader at X is out of the pursuer's reach after t; negative if it can be captured."""
    offset = X - P - np.multiply.outer(t, [*game.wind_m_s, 0.0])
    if game.evader_space == "space":
        return np.linalg.norm(offset, axis=-1) - game.capture_radius_m - game.pursuer.speed_m_s * t
    beside = np.maximum(np.linalg.norm(offset[..., :2], axis=-1) - game.standoff.radius_m, 0.0)
    above = np.abs(offset[..., 2] + game.standoff.height_m)
    if isinstance(game.pursuer, Ball):
        return np.hypot(beside, above) - game.capture_radius_m - game.pursuer.speed_m_s * t
    needs_climb = offset[..., 2] + game.standoff.height_m > 0
    vertical = np.where(needs_climb, game.pursuer.climb_m_s, game.pursuer.descent_m_s)
    return np.maximum(
        beside - game.capture_radius_m - game.pursuer.horizontal_m_s * t,
        above - game.capture_radius_m - vertical * t,
    )


def headings(game, count, middle=None, spread=None):
    """Unit vectors: a full turn of them (a sphere of them in space), or a small patch around one."""
    if middle is not None:
        a = np.cross(middle, [0.3, 0.5, 0.8])
        a /= np.linalg.norm(a)
        b = np.cross(middle, a)
        if game.evader_space == "plane":
            a = np.array([-middle[1], middle[0], 0.0])
            b = np.zeros(3)
        s, r = np.meshgrid(
            np.linspace(-spread, spread, count),
            np.linspace(-spread, spread, count if b.any() else 1),
        )
        patch = middle + s.reshape(-1, 1) * a + r.reshape(-1, 1) * b
        return patch / np.linalg.norm(patch, axis=1, keepdims=True)
    if game.evader_space == "plane":
        angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
        return np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    k = np.arange(4 * count) + 0.5
    polar = np.arccos(1.0 - k / (2 * count))
    turn = np.pi * (1.0 + 5.0**0.5) * k
    return np.stack(
        [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1
    )


def capture_times(game, P, E, n):
    """When an evader that runs along each heading can first be held captured, by bisection on the definition."""
    low = np.zeros(len(n))
    high = np.full(len(n), 1e4)

    def out(t):
        return (
            shortfall(
                game, P, E + (game.evader_speed_m_s * (t + game.information_age_s))[:, None] * n, t
            )
            > 0
        )

    for _ in range(58):  # 3e-14 s
        middle = 0.5 * (low + high)
        beyond = out(middle)
        low = np.where(beyond, middle, low)
        high = np.where(beyond, high, middle)
    return np.where(out(np.zeros(len(n))), high, 0.0)


def extremum(game, P, E, T):
    """PE: the largest capture time over all headings; TAD: the smallest distance from the target at a capture."""

    def cost(n):
        t = capture_times(game, P, E, n)
        if T is None:
            return -t
        X = E + (game.evader_speed_m_s * (t + game.information_age_s))[:, None] * n
        return np.linalg.norm(
            X - T - np.multiply.outer(t, [*game.target_velocity_m_s, 0.0]), axis=1
        )

    n = headings(game, 720)
    best = n[np.argmin(cost(n))]
    spread = 0.02 if game.evader_space == "plane" else 0.06
    for _ in range(8):
        n = headings(game, 17, best, spread)
        best = n[np.argmin(cost(n))]
        spread = spread / 5
    return abs(cost(best[None])[0])


@pytest.fixture(scope="session")
def oracle():
    return SimpleNamespace(
        states=random_states,
        shortfall=shortfall,
        capture_times=capture_times,
        extremum=extremum,
        headings=headings,
    )
