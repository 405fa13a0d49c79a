"""Every number of the package at fixed states, compared with tests/data/games_reference.npz.

The other tests check correctness from the definitions; this one checks that results have not changed, to 1e-9. After an
intended change: `python tests/game/test_solution_reference.py`.
"""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from guidance.game import (
    EVADER_POLICIES,
    PURSUER_POLICIES,
    Ball,
    Cylinder,
    Exact,
    Game,
    Paper,
    StandOff,
    apollonius_circle,
    apollonius_sphere,
    barrier,
    rollout,
    solve,
)

KEPT = Path(__file__).parents[1] / "data" / "games_reference.npz"
DISC = StandOff(3.0, 2.0)
GAMES = {
    "paper": Game(Ball(2.0), 1.0),
    "fast": Game(Ball(3.7), 1.3),
    "radius": Game(Ball(2.0), 1.0, capture_radius_m=1.5),
    "age": Game(Ball(2.0), 1.0, standoff=StandOff(1.5, 0.0), information_age_s=1.0),
    "disc": Game(Ball(2.0), 1.0, standoff=DISC, capture_radius_m=0.5),
    "wind": Game(Ball(2.0), 1.0, wind_m_s=(0.3, -0.4)),
    "all": Game(
        Ball(2.0),
        1.0,
        wind_m_s=(0.3, -0.4),
        standoff=DISC,
        information_age_s=0.5,
        capture_radius_m=0.2,
    ),
    "cylinder": Game(Cylinder(2.0, 0.7, 0.5), 1.0),
    "cylinder_disc": Game(Cylinder(2.0, 0.7, 0.5), 1.0, standoff=DISC, capture_radius_m=0.5),
    "cylinder_all": Game(
        Cylinder(2.0, 0.7, 0.5),
        1.0,
        wind_m_s=(0.2, 0.5),
        standoff=DISC,
        information_age_s=0.5,
        capture_radius_m=0.2,
    ),
    "moving": Game(Ball(2.0), 1.0, target_velocity_m_s=(0.3, 0.2)),
    "moving_cylinder": Game(
        Cylinder(2.0, 0.7, 0.5),
        1.0,
        standoff=DISC,
        target_velocity_m_s=(0.1, -0.3),
        information_age_s=0.2,
    ),
    "fast_all": Game(
        Ball(3.7),
        1.3,
        wind_m_s=(0.5, 0.6),
        standoff=DISC,
        information_age_s=0.4,
        capture_radius_m=0.3,
    ),
    "fast_cylinder": Game(
        Cylinder(3.7, 0.9, 1.6), 1.3, standoff=DISC, information_age_s=0.4, capture_radius_m=0.3
    ),
    "fast_moving": Game(Ball(3.7), 1.3, target_velocity_m_s=(0.3, 0.2)),
    "fast_moving_cylinder": Game(
        Cylinder(3.7, 0.9, 1.6), 1.3, standoff=DISC, target_velocity_m_s=(0.1, -0.3)
    ),
    "space": Game(Ball(2.0), 1.0, evader_space="space"),
    "space_radius": Game(
        Ball(2.0), 1.0, evader_space="space", capture_radius_m=0.5, information_age_s=0.3
    ),
}


def states(game):
    """Positions and the evader's velocity: drawn at random, near and far, and every degenerate one."""
    rng = np.random.default_rng(11)
    P, E, T = rng.uniform(-20.0, 20.0, (3, 48, 3))
    P[:, 2] = np.abs(P[:, 2])
    P[24:, :] = 0.2 * P[24:, :]
    E[24:, :] = 0.2 * E[24:, :]
    P[40:, :2] = E[40:, :2] + rng.uniform(-4.0, 4.0, (8, 2))
    special = [
        ((1.0, 2.0, 6.0), (1.0, 2.0, 0.0), (9.0, 1.0, 0.0)),  # right above
        ((1.0, 2.0, 2.0), (1.0, 2.0, 0.0), (9.0, 1.0, 0.0)),  # right above, on the disc
        ((1.0, 2.0, 0.0), (1.0, 2.0, 0.0), (9.0, 1.0, 0.0)),  # captured
        ((4.0, 2.0, 2.0), (1.0, 2.0, 0.0), (9.0, 1.0, 0.0)),  # on the rim
        ((8.0, 2.0, 0.0), (1.0, 2.0, 0.0), (9.0, 1.0, 0.0)),  # in the plane
        ((8.0, 2.0, 5.0), (9.0, 1.0, 0.0), (9.0, 1.0, 0.0)),  # arrived
        ((9.0, 1.0, 0.0), (1.0, 2.0, 0.0), (9.0, 1.0, 0.0)),  # guarding
        ((2.0, 2.0, 1.0), (1.0, 2.0, 0.0), (9.0, 1.0, 0.0)),  # below the disc
        ((np.nan, 2.0, 1.0), (1.0, 2.0, 0.0), (9.0, 1.0, 0.0)),  # unknown
        ((8.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, 0.0, 0.0)),  # on the barrier of δ = 2
        ((6.0, 0.0, 0.0), (4.0, 0.0, 0.0), (4.0, 0.0, 0.0)),  # c beside T
    ]
    P, E, T = (
        np.concatenate([drawn, [row[index] for row in special]])
        for index, drawn in enumerate((P, E, T))
    )
    if game.evader_space == "plane":
        E[:, 2] = T[:, 2] = 0.0
    return P, E, T, rng.uniform(-0.9, 0.9, E.shape) * [1.0, 1.0, 0.0]


def played(name, kind):
    """Yield the results of one game: both players' play, and every policy."""
    game = GAMES[name]
    P, E, T, seen = states(game)
    target = T if kind == "tad" else None
    for told, velocity in (("", None), ("seen_", seen)):
        for field, value in (
            solve(game, P, E, target, evader_velocity_m_s=velocity)._asdict().items()
        ):
            yield f"{told}{field}", value
    catalogue = {f"pursuer_{name}": play for name, play in PURSUER_POLICIES.items()}
    catalogue |= {f"evader_{name}": play for name, play in EVADER_POLICIES.items()}
    for policy, play in catalogue.items():
        if kind == "tad" or "task" not in policy:
            yield policy, play(game, P, E, target, seen)


def ends():
    """Yield rollouts: located ends and the paper's stepping, and a second of a curved chase of a moving target."""
    P, E, T, _ = (array[24:26] for array in states(GAMES["paper"]))
    for kind, stepping in (
        ("exact", Exact(0.1)),
        ("straight", Exact(0.1, order=1)),
        ("paper", Paper(0.1)),
    ):
        curve = {"pursuer_policy": "pure_pursuit", "stepping": stepping, "duration_s": 1.0}
        played = {f"{kind}_moving": rollout(GAMES["fast_moving"], P, E, T, **curve)}
        if kind != "straight":
            for evader, target in (("pure_evade", None), ("optimal", T)):
                end = rollout(GAMES["paper"], P, E, target, evader_policy=evader, stepping=stepping)
                played[f"{kind}_{evader}"] = end
        for name, end in played.items():
            yield from (
                (f"{name}_{field}", value)
                for field, value in end._asdict().items()
                if field != "path"
            )


def shapes():
    """Yield circle, sphere and barrier."""
    P, E, T, _ = states(GAMES["paper"])
    for name, (centre, radius) in (
        ("circle", apollonius_circle(P, E, 2.0)),
        ("sphere", apollonius_sphere(P, E, 1.7)),
    ):
        yield f"{name}_0", centre
        yield f"{name}_1", radius
    yield "barrier", barrier(P, E, T, 2.0)


PARTS = {f"{name}_{kind}_": partial(played, name, kind) for name in GAMES for kind in ("pe", "tad")}
PARTS |= {"end_": ends, "shape_": shapes}


def computed(part):
    return {f"{part}{name}": np.asarray(value, dtype=float) for name, value in PARTS[part]()}


@pytest.mark.parametrize("part", PARTS)
def test_no_number_has_changed(part):
    """Catches any number of a solution that changes without intent."""
    with np.load(KEPT) as kept:
        found = computed(part)
        assert found.keys() == {name for name in kept if name.startswith(part)}
        for name, value in found.items():
            np.testing.assert_allclose(
                value, kept[name], rtol=1e-7, atol=1e-9, err_msg=name, equal_nan=True
            )


if __name__ == "__main__":
    np.savez_compressed(
        KEPT, **{name: value for part in PARTS for name, value in computed(part).items()}
    )
