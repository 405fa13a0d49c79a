"""Every number of the package at fixed states, beside those kept in tests/data/games_reference.npz.

The other tests say what is right, from the definitions; this one says that nothing else has changed, to 1e-9. After a
change that is meant to change results: `python tests/game/test_reference.py`.
"""

from pathlib import Path

import numpy as np

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
    hji_residual,
    rollout,
    solve,
    value_gradient,
)

KEPT = Path(__file__).parents[1] / "data" / "games_reference.npz"
DISC = StandOff(3.0, 2.0)
GAMES = {
    "paper": Game(Ball(2.0), 1.0),
    "fast": Game(Ball(3.7), 1.3),
    "radius": Game(Ball(2.0), 1.0, capture_radius_m=1.5),
    "age": Game(Ball(2.0), 1.0, information_age_s=1.0),
    "disc": Game(Ball(2.0), 1.0, standoff=DISC, capture_radius_m=0.5),
    "wind": Game(Ball(2.0), 1.0, wind_m_s=(0.3, -0.4)),
    "all": Game(Ball(2.0), 1.0, wind_m_s=(0.3, -0.4), standoff=DISC, information_age_s=0.5, capture_radius_m=0.2),
    "cylinder": Game(Cylinder(2.0, 0.7, 0.5), 1.0),
    "cylinder_disc": Game(Cylinder(2.0, 0.7, 0.5), 1.0, standoff=DISC, capture_radius_m=0.5),
    "cylinder_all": Game(
        Cylinder(2.0, 0.7, 0.5), 1.0, wind_m_s=(0.2, 0.5), standoff=DISC, information_age_s=0.5, capture_radius_m=0.2
    ),
    "moving": Game(Ball(2.0), 1.0, target_velocity_m_s=(0.3, 0.2)),
    "moving_cylinder": Game(
        Cylinder(2.0, 0.7, 0.5), 1.0, standoff=DISC, target_velocity_m_s=(0.1, -0.3), information_age_s=0.2
    ),
    "space": Game(Ball(2.0), 1.0, evader_space="space"),
    "space_radius": Game(Ball(2.0), 1.0, evader_space="space", capture_radius_m=0.5, information_age_s=0.3),
}


def states(game):
    """Positions and the evader's velocity: drawn at random, near and far, and every degenerate one."""
    rng = np.random.default_rng(11)
    P, E, T = rng.uniform(-20.0, 20.0, (3, 48, 3))
    P[:, 2] = np.abs(P[:, 2])
    P[24:, :], E[24:, :] = 0.2 * P[24:, :], 0.2 * E[24:, :]
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
    P, E, T = (np.concatenate([drawn, [row[index] for row in special]]) for index, drawn in enumerate((P, E, T)))
    if game.evader_space == "plane":
        E[:, 2] = T[:, 2] = 0.0
    return P, E, T, rng.uniform(-0.9, 0.9, E.shape) * [1.0, 1.0, 0.0]


def computed():
    """Yield all results by name."""
    yield from shapes().items()
    yield from ends().items()
    for name, game in GAMES.items():
        for kind, with_target in (("pe", False), ("tad", True)):
            for key, value in answers(game, with_target=with_target):
                yield f"{name}_{kind}_{key}", value


def answers(game, *, with_target):
    """What is said of one game: both players' play, the gradient, the residual, and every policy."""
    P, E, T, seen = states(game)
    target = T if with_target else None
    for told, velocity in (("", None), ("seen_", seen)):
        for field, value in solve(game, P, E, target, evader_velocity_m_s=velocity)._asdict().items():
            yield f"{told}{field}", value
    if not with_target or game.target_velocity_m_s == (0.0, 0.0):
        where = (game, P[:48:3], E[:48:3], T[:48:3] if with_target else None)
        yield "residual", np.asarray(hji_residual(*where)).round(5)
        if game.evader_space == "plane":
            for index, part in enumerate(value_gradient(*where)):
                yield f"gradient_{index}", np.asarray(part)
    if game.evader_space == "plane":
        sunk = P[:48] - [0.0, 0.0, 9.0]
        for index, part in enumerate(value_gradient(game, sunk, E[:48], T[:48] if with_target else None)):
            yield f"sunk_gradient_{index}", np.asarray(part)
    catalogue = {f"pursuer_{name}": play for name, play in PURSUER_POLICIES.items()}
    catalogue |= {f"evader_{name}": play for name, play in EVADER_POLICIES.items()}
    for name, play in catalogue.items():
        if with_target or "task" not in name:
            yield name, play(game, P, E, target, seen)


def ends():
    """Rollouts of the paper's game: located ends and the paper's stepping."""
    found, game = {}, GAMES["paper"]
    P, E, T, _ = states(game)
    for kind, stepping in (("exact", Exact(0.1)), ("paper", Paper(0.1))):
        for evader, target in (("pure_evade", None), ("optimal", T[24:26])):
            played = rollout(game, P[24:26], E[24:26], target, evader_policy=evader, stepping=stepping)
            for field in ("end", "time_s", "pursuer_m", "evader_m", "distance_m"):
                found[f"{kind}_{evader}_{field}"] = np.asarray(getattr(played, field))
    return found


def shapes():
    """Circle, sphere and barrier."""
    P, E, T, _ = states(GAMES["paper"])
    circle, sphere = apollonius_circle(P, E, 2.0), apollonius_sphere(P, E, 1.7)
    parts = {f"circle_{index}": np.asarray(part) for index, part in enumerate(circle)}
    parts |= {f"sphere_{index}": np.asarray(part) for index, part in enumerate(sphere)}
    return parts | {"barrier": barrier(P, E, T, 2.0)}


def test_no_number_has_changed():
    kept = dict(np.load(KEPT))
    seen = set()
    for name, value in computed():
        seen.add(name)
        np.testing.assert_allclose(
            np.asarray(value, dtype=float), kept[name], rtol=1e-7, atol=1e-9, err_msg=name, equal_nan=True
        )
    assert seen == set(kept)


if __name__ == "__main__":
    np.savez_compressed(KEPT, **{name: np.asarray(value, dtype=float) for name, value in computed()})
