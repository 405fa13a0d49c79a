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
from guidance.game.arrays import FloatArray
from guidance.game.rollout import Paper, Sample
from guidance.log.scene import circle_points

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

# Policies of pursuer and evader, and the published number.
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
        return {
            "pursuer": self.pursuer_policy,
            "evader": self.evader_policy,
            "published": float(self.published),
            "stepped": float(self.stepped),
            "exact": float(self.exact),
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
    def policies(self) -> tuple[str, ...]:
        """Both policies as the paper writes them: u* and v* are the optimal ones, the others keep their names."""
        return _paper_name(self.pursuer_policy, "u*"), _paper_name(self.evader_policy, "v*")


def _paper_name(policy: str, optimum: str) -> str:
    return optimum if policy == "optimal" else policy.replace("_", "-")


class PublishedTable(NamedTuple):
    """A published table."""

    title: str
    quantity: str
    cases: tuple[Case, ...]


def tables() -> tuple[PublishedTable, PublishedTable]:
    """Compute both tables of section V."""
    pe = tuple(_case(row, PE_PURSUER, PE_EVADER, None) for row in TABLE_1)
    tad = tuple(_case(row, TAD_PURSUER, TAD_EVADER, TAD_TARGET) for row in TABLE_2)
    pe_title = "Table 1: PE game, P = (8.00, 1.42, 9.41), E = (7.92, 9.60), δ = 2"
    tad_title = "Table 2: TAD game, P = (6.97, 5.83, 9.15), E = (9.80, 0.33), T = (0, 0), δ = 2"
    pe_table = PublishedTable(pe_title, "time cost, s", pe)
    tad_table = PublishedTable(tad_title, "final distance to the target, m", tad)
    return pe_table, tad_table


def _case(
    row: tuple[str, str, str], pursuer: FloatArray, evader: FloatArray, target: FloatArray | None
) -> Case:
    pursues, flees, published = row
    play = partial(
        rollout, GAME, pursuer, evader, target, pursuer_policy=pursues, evader_policy=flees
    )
    stepped = play(stepping=Paper())
    exact = play(keep_path=True)
    _, _, decimals = published.partition(".")
    digits = len(decimals)
    stepped_cost = float(stepped.time_s if target is None else stepped.distance_m)
    exact_cost = float(exact.time_s if target is None else exact.distance_m)
    return Case(*row, f"{stepped_cost:.{digits}f}", f"{exact_cost:.4f}", exact.path)


def draw_figures(pe: PublishedTable, tad: PublishedTable, folder: Path) -> list[Path]:
    """Draw the PE game with sphere and circle, and both parts of the TAD game, as PNG and PDF; return the paths.

    Needs matplotlib, and a folder that exists.

    Raises:
        OutputError: If they cannot be written.
    """
    from guidance.viz.figures import figure_of, save_twice  # noqa: PLC0415 - matplotlib is optional

    pe_figure = figure_of(7.5, 7.0)
    _draw_pe(pe_figure, pe.cases)
    first_part = figure_of(9.0, 4.8)
    first_title = "TAD game, part 1: u* against the evader's strategies"
    _draw_tad(first_part, tad.cases[:3], first_title)
    second_part = figure_of(9.0, 4.8)
    second_title = "TAD game, part 2: the pursuer's policies against v*"
    _draw_tad(second_part, tad.cases[2:], second_title)
    figures = {"pe": pe_figure, "tad-part-1": first_part, "tad-part-2": second_part}
    paths = []
    with writing(folder):
        for name, figure in figures.items():
            paths += save_twice(figure, folder / name, dpi=200)
    return paths


def _plot_tracks(axes: Any, cases: Sequence[Case], dimensions: list[int], unit: str) -> None:  # noqa: ANN401 - matplotlib's
    """Draw every play with its own line. The optimal one is below the others, and wide, so that both remain visible."""
    dashes = iter(("--", ":"))
    for case in sorted(cases, key=lambda case: not case.is_optimal):
        style: dict[str, Any]
        if case.is_optimal:
            style = {"linestyle": "-", "linewidth": 3.0}
        else:
            style = {"linestyle": next(dashes)}
        pursuer = np.stack([sample.pursuer_m for sample in case.path])[:, dimensions]
        evader = np.stack([sample.evader_m for sample in case.path])[:, dimensions]
        policies = " / ".join(case.policies)
        label = f"{policies}: {case.exact} {unit}"
        axes.plot(*pursuer.T, color=RED, zorder=4, label=label, **style)
        axes.plot(*evader.T, color=BLUE, zorder=3, **style)


def _draw_pe(figure: Any, cases: Sequence[Case]) -> None:  # noqa: ANN401
    figure.set_layout_engine(None)
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    sphere = apollonius_sphere(PE_PURSUER, PE_EVADER, RATIO)
    section = apollonius_circle(PE_PURSUER, PE_EVADER, RATIO)
    # Points on the sphere, (13, 25) each.
    radius_m = float(sphere.radius_m)
    longitudes_rad = np.linspace(0, 2 * np.pi, 25)
    latitudes_rad = np.linspace(-np.pi / 2, np.pi / 2, 13)
    longitude_rad, latitude_rad = np.meshgrid(longitudes_rad, latitudes_rad)
    level = np.cos(latitude_rad)
    centre_x, centre_y, centre_z = sphere.centre_m
    x = centre_x + radius_m * (level * np.cos(longitude_rad))
    y = centre_y + radius_m * (level * np.sin(longitude_rad))
    z = centre_z + radius_m * np.sin(latitude_rad)
    shell = x, y, z
    axes.plot_wireframe(*shell, color="0.75", linewidth=0.5, zorder=1)
    ring = circle_points(section.centre_m, float(section.radius_m)).T
    axes.plot(*ring, 0.0, zorder=2, label="Apollonius circle (on the sphere)", **_APOLLONIUS)
    _plot_tracks(axes, cases, [0, 1, 2], "s")
    meeting_m = solve(GAME, PE_PURSUER, PE_EVADER).meeting_point_m
    points = (
        ("P", "^", PE_PURSUER),
        ("E", "s", PE_EVADER),
        ("c", "+", section.centre_m),
        ("q*", "*", meeting_m),
    )
    for name, marker, (x, y, z) in points:
        axes.plot(x, y, z, color="black", marker=marker, linestyle="", markersize=9, zorder=5)
        axes.text(x + 0.9, y, z + 0.6, name, zorder=6, fontsize=12)
    axes.set(
        xlabel="x, m",
        ylabel="y, m",
        zlabel="z, m",
        title="PE game, δ = 2: pursuer light, evader dark",
    )
    level_ticks = range(0, 21, 5)
    axes.set(xticks=level_ticks, yticks=level_ticks, zticks=range(-10, 11, 5))
    axes.set_aspect("equal")
    axes.view_init(elev=22, azim=-35)
    figure.legend(loc="lower center", ncols=2, frameon=False, fontsize=9)
    figure.subplots_adjust(left=0.0, right=0.95, bottom=0.12, top=0.95)


def _draw_tad(figure: Any, cases: Sequence[Case], title: str) -> None:  # noqa: ANN401
    section = apollonius_circle(TAD_PURSUER, TAD_EVADER, RATIO)
    g = solve(GAME, TAD_PURSUER, TAD_EVADER, TAD_TARGET).meeting_point_m
    plan, side = figure.subplots(1, 2)
    points_m = (TAD_PURSUER, TAD_EVADER, TAD_TARGET, section.centre_m, g)
    for axes, up, height in ((plan, 1, "y"), (side, 2, "z")):
        _plot_tracks(axes, cases, [0, up], "m")
        for name, marker, point_m in zip(OFFSETS, "^so+*", points_m, strict=True):
            position = (point_m[0], point_m[up])
            beside = {"xytext": OFFSETS[name], "textcoords": "offset points"}
            axes.plot(*position, color="black", marker=marker, linestyle="", markersize=8)
            axes.annotate(name, position, **beside, fontsize=12)
        axes.set(xlabel="x, m", ylabel=f"{height}, m")
        axes.set_aspect("equal")
        axes.grid(color="0.9", linewidth=0.5)
        axes.margins(0.12, 0.16)
    ring = circle_points(section.centre_m, float(section.radius_m)).T
    plan.plot(*ring, **_APOLLONIUS)
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
