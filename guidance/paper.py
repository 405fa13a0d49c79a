"""The published tables and figures of Li, Wang & Xie, computed again.

Each of the eight published cells is played with the paper's stepping, and again with its end located exactly.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from guidance.files import writing
from guidance.game import Ball, Game, apollonius_circle, apollonius_sphere, rollout, solve
from guidance.game.rollout import Paper, Sample
from guidance.log.scene import Array, circle

GAME = Game(Ball(2.0), evader_speed_m_s=1.0)
"""δ = 2. The paper gives no speeds; its times are those of v = 1 m/s."""

PE_PURSUER = np.array([8.00, 1.42, 9.41])
PE_EVADER = np.array([7.92, 9.60, 0.0])
TAD_PURSUER = np.array([6.97, 5.83, 9.15])
TAD_EVADER = np.array([9.80, 0.33, 0.0])
TAD_TARGET = np.zeros(3)

RED = "#e8867a"
BLUE = "#123a7a"
"""Colours, and their darkness, distinguish the players; line styles distinguish the plays of a figure."""

OFFSETS = {"P": (8, 2), "E": (4, 8), "T": (-4, 10), "c": (4, -16), "g*": (-22, -12)}
"""Offset of a label from its point, in points."""

RATIO = 2.0
_APOLLONIUS = {"color": "black", "linestyle": (0, (5, 3)), "linewidth": 1.2}

# Strategies of pursuer and evader, and the published number.
TABLE_1 = (
    ("pure_pursuit", "optimal", "11.05"),
    ("optimal", "pure_evade", "10.43"),
    ("optimal", "optimal", "10.43"),
)
TABLE_2 = (
    ("optimal", "task_oriented", "4.2341"),
    ("optimal", "pure_evade", "19.4309"),
    ("optimal", "optimal", "4.1481"),
    ("pure_pursuit", "optimal", "3.2272"),
    ("task_oriented", "optimal", "0.0046"),
)


class Case(NamedTuple):
    """A published number beside ours.

    Attributes:
        pursuer_policy: name in `PURSUER_POLICIES`.
        evader_policy: name in `EVADER_POLICIES`.
        published: the number as printed.
        stepped: ours with the paper's stepping, rounded to the published digits.
        exact: ours with the end located exactly, to four digits.
        path: every sample of the exact play.
    """

    pursuer_policy: str
    evader_policy: str
    published: str
    stepped: str
    exact: str
    path: tuple[Sample, ...]

    @property
    def plain(self) -> dict[str, Any]:
        """The numbers without the path, for JSON."""
        numbers = {name: float(getattr(self, name)) for name in ("published", "stepped", "exact")}
        return {
            "pursuer": self.pursuer_policy,
            "evader": self.evader_policy,
            **numbers,
            "matches": self.matches,
        }

    @property
    def matches(self) -> bool:
        """True if every published digit is reproduced."""
        return self.stepped == self.published

    @property
    def is_optimal(self) -> bool:
        """True if both players play their optimum."""
        return self.pursuer_policy == self.evader_policy == "optimal"

    @property
    def strategies(self) -> tuple[str, ...]:
        """Both strategies as the paper writes them: u* and v* are the optimal ones, the others keep their names."""
        policies = ((self.pursuer_policy, "u*"), (self.evader_policy, "v*"))
        return tuple(
            star if name == "optimal" else name.replace("_", "-") for name, star in policies
        )


class Table(NamedTuple):
    """A published table."""

    title: str
    quantity: str
    cases: tuple[Case, ...]


def tables() -> tuple[Table, Table]:
    """Compute both tables of section V."""
    pe = tuple(_case(row, PE_PURSUER, PE_EVADER, None) for row in TABLE_1)
    tad = tuple(_case(row, TAD_PURSUER, TAD_EVADER, TAD_TARGET) for row in TABLE_2)
    pe_title = "Table 1: PE game, P = (8.00, 1.42, 9.41), E = (7.92, 9.60), δ = 2"
    tad_title = "Table 2: TAD game, P = (6.97, 5.83, 9.15), E = (9.80, 0.33), T = (0, 0), δ = 2"
    return Table(pe_title, "time cost, s", pe), Table(
        tad_title, "final distance to the target, m", tad
    )


def _case(row: tuple[str, str, str], pursuer: Array, evader: Array, target: Array | None) -> Case:
    pursues, flees, published = row
    play = partial(
        rollout, GAME, pursuer, evader, target, pursuer_policy=pursues, evader_policy=flees
    )
    stepped = play(stepping=Paper())
    exact = play(keep_path=True)
    digits = len(published.partition(".")[2])
    ours = [float(end.time_s if target is None else end.distance_m) for end in (stepped, exact)]
    return Case(*row, f"{ours[0]:.{digits}f}", f"{ours[1]:.4f}", exact.path)


def draw_figures(pe: Table, tad: Table, folder: Path) -> list[Path]:
    """Draw the PE game with sphere and circle, and both parts of the TAD game, as PNG and PDF; return the paths.

    Needs matplotlib, and a folder that exists.

    Raises:
        OutputError: If they cannot be written.
    """
    from guidance.viz.figures import figure_of, save_twice  # noqa: PLC0415 - matplotlib is optional

    figures = {
        "pe": figure_of(7.5, 7.0),
        "tad-part-1": figure_of(9.0, 4.8),
        "tad-part-2": figure_of(9.0, 4.8),
    }
    _draw_pe(figures["pe"], pe.cases)
    _draw_tad(
        figures["tad-part-1"], tad.cases[:3], "TAD game, part 1: u* against the evader's strategies"
    )
    _draw_tad(
        figures["tad-part-2"],
        tad.cases[2:],
        "TAD game, part 2: the pursuer's strategies against v*",
    )
    with writing(folder):
        return [
            path
            for name, figure in figures.items()
            for path in save_twice(figure, folder / name, dpi=200)
        ]


def _plot_tracks(axes: Any, cases: Sequence[Case], dimensions: list[int], unit: str) -> None:  # noqa: ANN401 - matplotlib's
    """Draw every play with its own line. The optimal one is below the others, and wide, so that both remain visible."""
    dashes = iter(("--", ":"))
    for case in sorted(cases, key=lambda case: not case.is_optimal):
        style = (
            {"linestyle": "-", "linewidth": 3.0} if case.is_optimal else {"linestyle": next(dashes)}
        )
        pursuer = np.stack([sample.pursuer_m for sample in case.path])
        evader = np.stack([sample.evader_m for sample in case.path])
        label = f"{' / '.join(case.strategies)}: {case.exact} {unit}"
        axes.plot(*pursuer[:, dimensions].T, color=RED, zorder=4, label=label, **style)
        axes.plot(*evader[:, dimensions].T, color=BLUE, zorder=3, **style)


def _draw_pe(figure: Any, cases: Sequence[Case]) -> None:  # noqa: ANN401
    figure.set_layout_engine(None)
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    sphere, section = (
        shape(PE_PURSUER, PE_EVADER, RATIO) for shape in (apollonius_sphere, apollonius_circle)
    )
    longitude, latitude = np.meshgrid(
        np.linspace(0, 2 * np.pi, 25), np.linspace(-np.pi / 2, np.pi / 2, 13)
    )
    outward = (
        np.cos(latitude) * np.cos(longitude),
        np.cos(latitude) * np.sin(longitude),
        np.sin(latitude),
    )
    shell = [
        centre + sphere.radius_m * part
        for centre, part in zip(sphere.centre_m, outward, strict=True)
    ]
    axes.plot_wireframe(*shell, color="0.75", linewidth=0.5, zorder=1)
    ring = circle(section.centre_m, float(section.radius_m)).T
    axes.plot(*ring, 0.0, zorder=2, label="Apollonius circle (on the sphere)", **_APOLLONIUS)
    _plot_tracks(axes, cases, [0, 1, 2], "s")
    places = (
        PE_PURSUER,
        PE_EVADER,
        section.centre_m,
        solve(GAME, PE_PURSUER, PE_EVADER).meeting_point_m,
    )
    for name, marker, point in zip(("P", "E", "c", "q*"), "^s+*", places, strict=True):
        axes.plot(*point, color="black", marker=marker, linestyle="", markersize=9, zorder=5)
        axes.text(point[0] + 0.9, point[1], point[2] + 0.6, name, zorder=6, fontsize=12)
    axes.set(
        xlabel="x, m",
        ylabel="y, m",
        zlabel="z, m",
        title="PE game, δ = 2: pursuer light, evader dark",
    )
    axes.set(xticks=range(0, 21, 5), yticks=range(0, 21, 5), zticks=range(-10, 11, 5))
    axes.set_aspect("equal")
    axes.view_init(elev=22, azim=-35)
    figure.legend(loc="lower center", ncols=2, frameon=False, fontsize=9)
    figure.subplots_adjust(left=0.0, right=0.95, bottom=0.12, top=0.95)


def _draw_tad(figure: Any, cases: Sequence[Case], title: str) -> None:  # noqa: ANN401
    section = apollonius_circle(TAD_PURSUER, TAD_EVADER, RATIO)
    g = solve(GAME, TAD_PURSUER, TAD_EVADER, TAD_TARGET).meeting_point_m
    plan, side = figure.subplots(1, 2)
    places = (TAD_PURSUER, TAD_EVADER, TAD_TARGET, section.centre_m, g)
    for axes, up, height in ((plan, 1, "y"), (side, 2, "z")):
        _plot_tracks(axes, cases, [0, up], "m")
        for (name, offset), marker, point in zip(OFFSETS.items(), "^so+*", places, strict=True):
            axes.plot(point[0], point[up], color="black", marker=marker, linestyle="", markersize=8)
            axes.annotate(
                name, (point[0], point[up]), xytext=offset, textcoords="offset points", fontsize=12
            )
        axes.set(xlabel="x, m", ylabel=f"{height}, m")
        axes.set_aspect("equal")
        axes.grid(color="0.9", linewidth=0.5)
        axes.margins(0.12, 0.16)
    plan.plot(*circle(section.centre_m, float(section.radius_m)).T, **_APOLLONIUS)
    plan.set_title("from above, Apollonius circle dashed", fontsize=10)
    side.set_title("from the side", fontsize=10)
    figure.suptitle(f"{title}; pursuer light, evader dark", fontsize=12)
    figure.legend(
        *plan.get_legend_handles_labels(),
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize=9,
    )
