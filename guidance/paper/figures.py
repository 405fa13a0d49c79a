"""The three published figures: the PE game with sphere and circle, and both parts of the TAD game."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from guidance.files import writing
from guidance.game import apollonius_circle, apollonius_sphere, solve
from guidance.paper.cases import GAME, PE_EVADER, PE_PURSUER, TAD_EVADER, TAD_PURSUER, TAD_TARGET, Case, Table
from guidance.viz.figures import figure_of

OPTIMAL, OTHERS = "-", ("--", ":")
"""Line styles distinguish the plays of a figure; colours, and their darkness, distinguish the players."""

RED, BLUE = "#e8867a", "#123a7a"
OFFSETS = {"P": (8, 2), "E": (4, 8), "T": (-4, 10), "c": (4, -16), "g*": (-22, -12)}
"""Offset of a label from its point, in points."""

RATIO = 2.0
DPI = 200


class PlayedTrack(NamedTuple):
    """The tracks of P and E, (samples, 3), m."""

    pursuer: NDArray[np.float64]
    evader: NDArray[np.float64]


def draw_figures(pe: Table, tad: Table, folder: Path) -> list[Path]:
    """Draw the three figures as PNG and PDF into a folder that is there, and return their paths.

    Raises:
        OutputError: If they cannot be written.
    """
    drawn = {
        "pe": _pe_figure(pe.cases),
        "tad-part-1": _tad_figure(tad.cases[:3], "TAD game, part 1: u* against the evader's strategies"),
        "tad-part-2": _tad_figure(tad.cases[2:], "TAD game, part 2: the pursuer's strategies against v*"),
    }
    paths = []
    for name, figure in drawn.items():
        for kind in ("png", "pdf"):
            path = folder / f"{name}.{kind}"
            with writing(path):
                figure.savefig(path, dpi=DPI, metadata={"CreationDate": None} if kind == "pdf" else None)
            figure.set_layout_engine(None)  # it is laid out now
            paths.append(path)
    return paths


def _track(case: Case) -> PlayedTrack:
    return PlayedTrack(
        np.stack([sample.pursuer_m for sample in case.path]), np.stack([sample.evader_m for sample in case.path])
    )


def _styled(cases: Sequence[Case]) -> Iterator[tuple[Case, dict[str, Any]]]:
    """Give every play its line, the optimal one first: it is broad, so that one on top of it shows both."""
    dashes = iter(OTHERS)
    for case in sorted(cases, key=lambda case: not case.is_optimal):
        yield case, {"linestyle": OPTIMAL, "linewidth": 3.0} if case.is_optimal else {"linestyle": next(dashes)}


def _label(case: Case, unit: str) -> str:
    pursuer, evader = case.strategies
    return f"{pursuer} / {evader}: {case.exact} {unit}"


def _pe_figure(cases: Sequence[Case]) -> Figure:
    pursuer, evader = np.asarray(PE_PURSUER), np.asarray(PE_EVADER)
    figure = Figure(figsize=(7.5, 7.0))
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    sphere, circle = apollonius_sphere(pursuer, evader, RATIO), apollonius_circle(pursuer, evader, RATIO)
    longitude, latitude = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(-np.pi / 2, np.pi / 2, 13))
    outward = (np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude))
    shell = [centre + sphere.radius_m * part for centre, part in zip(sphere.centre_m, outward, strict=True)]
    axes.plot_wireframe(*shell, color="0.75", linewidth=0.5, zorder=1)
    axes.plot(
        *_ring(circle.centre_m, float(circle.radius_m)),
        0.0,
        color="black",
        linestyle=(0, (5, 3)),
        zorder=2,
        linewidth=1.2,
        label="Apollonius circle (on the sphere)",
    )
    for case, style in _styled(cases):
        track = _track(case)
        axes.plot(*track.pursuer.T, color=RED, zorder=4, label=_label(case, "s"), **style)
        axes.plot(*track.evader.T, color=BLUE, zorder=3, **style)
    q = solve(GAME, pursuer, evader).meeting_point_m
    for name, marker, place in (("P", "^", pursuer), ("E", "s", evader), ("c", "+", circle.centre_m), ("q*", "*", q)):
        axes.plot(*place, color="black", marker=marker, linestyle="", markersize=9, zorder=5)
        axes.text(place[0] + 0.9, place[1], place[2] + 0.6, name, zorder=6, fontsize=12)
    axes.set(xlabel="x, m", ylabel="y, m", zlabel="z, m", title="PE game, δ = 2: pursuer light, evader dark")
    axes.set(xticks=range(0, 21, 5), yticks=range(0, 21, 5), zticks=range(-10, 11, 5))
    axes.set_aspect("equal")
    axes.view_init(elev=22, azim=-35)
    figure.legend(loc="lower center", ncols=2, frameon=False, fontsize=9)
    figure.subplots_adjust(left=0.0, right=0.95, bottom=0.12, top=0.95)
    return figure


def _tad_figure(cases: Sequence[Case], title: str) -> Figure:
    pursuer, evader, target = (np.asarray(place) for place in (TAD_PURSUER, TAD_EVADER, TAD_TARGET))
    circle = apollonius_circle(pursuer, evader, RATIO)
    g = solve(GAME, pursuer, evader, target).meeting_point_m
    figure = figure_of(9.0, 4.8)
    plan, side = figure.subplots(1, 2)
    marked = (("P", "^", pursuer), ("E", "s", evader), ("T", "o", target), ("c", "+", circle.centre_m), ("g*", "*", g))
    for axes, up, height in ((plan, 1, "y"), (side, 2, "z")):
        for case, style in _styled(cases):
            track = _track(case)
            axes.plot(track.pursuer[:, 0], track.pursuer[:, up], color=RED, label=_label(case, "m"), **style)
            axes.plot(track.evader[:, 0], track.evader[:, up], color=BLUE, **style)
        _mark(axes, marked, up)
        axes.set(xlabel="x, m", ylabel=f"{height}, m")
        axes.set_aspect("equal")
        axes.grid(color="0.9", linewidth=0.5)
        axes.margins(0.12, 0.16)
    plan.plot(*_ring(circle.centre_m, float(circle.radius_m)), color="black", linestyle=(0, (5, 3)), linewidth=1.2)
    plan.set_title("from above, Apollonius circle dashed", fontsize=10)
    side.set_title("from the side", fontsize=10)
    figure.suptitle(f"{title}; pursuer light, evader dark", fontsize=12)
    figure.legend(*plan.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def _mark(axes: Axes, marked: Sequence[tuple[str, str, NDArray[np.float64]]], up: int) -> None:
    for name, marker, place in marked:
        axes.plot(place[0], place[up], color="black", marker=marker, linestyle="", markersize=8)
        axes.annotate(name, (place[0], place[up]), xytext=OFFSETS[name], textcoords="offset points", fontsize=12)


def _ring(centre: NDArray[np.float64], radius: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    return centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)
