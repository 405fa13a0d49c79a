"""Pictures of a sweep: regret, curves over each swept key, maps over two. Dashes and markers tell policies apart."""

import itertools
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from guidance.sweeps.axes import Array, Integers
from guidance.viz.figures import figure_of, legend_below, save_twice

_STYLES: Final = (
    {"color": "black", "linestyle": "-", "marker": "o"},
    {"color": "#b3261e", "linestyle": "--", "marker": "s"},
    {"color": "#0b5fa5", "linestyle": ":", "marker": "^"},
    {"color": "#2e7d32", "linestyle": "-.", "marker": "D"},
    {"color": "0.45", "linestyle": (0, (6, 2)), "marker": "v"},
    {"color": "#7b4fa3", "linestyle": (0, (1, 1)), "marker": "x"},
)
_MEASURES: Final = (
    ("share captured, with its 95 % interval", "games", "capture", ("low", "estimate", "high")),
    (
        "regret, {}: median, 5 % to 95 %",
        "regret_games",
        "regret_quantiles",
        ("0.05", "0.5", "0.95"),
    ),
)
"""What the curves show: label, number of games, and the keys of the measure and of the ends and middle of its band."""

_MOST_KEYS: Final = 6
_SHARES: Final = np.linspace(0.0, 1.0, 400)
_SHOWN: Final = 0.995
"""The regret's axis ends at this quantile, because a single game can flatten all others."""


class Key(NamedTuple):
    """Groups of rows by one column.

    Attributes:
        column: Name.
        labels: Of the groups.
        centres: Positions of the groups on an axis.
        places: Number of the group of every row.
        grid: Whether it is a key of the grid; the others are bins of a random draw.
    """

    column: str
    labels: Sequence[str]
    centres: Sequence[float]
    places: Integers
    grid: bool


def draw_all(
    report: Mapping[str, Any], keys: Sequence[Key], regrets: Sequence[Array], out: Path
) -> list[Path]:
    """Draw all pictures as PNG and PDF; return their paths.

    Args:
        report: As `summed_up` returns it.
        keys: The swept keys.
        regrets: Regrets of each pair of policies.
        out: The folder.

    Raises:
        OSError: If a file cannot be written.
    """
    grid = [key for key in keys if key.grid]
    figures = {"regret": _regret(report, [numbers for numbers in regrets if numbers.size])}
    figures["keys"] = _curves(report, keys[:_MOST_KEYS])
    if len(grid) == 2:
        down, across = grid
        figures["map"] = _map(report, down, across, "regret_mean", f"mean regret, {report['unit']}")
        figures["map-captures"] = _map(report, down, across, "capture", "share captured")
    drawn = {name: figure for name, figure in figures.items() if figure is not None}
    return [
        path
        for name, figure in drawn.items()
        for path in save_twice(figure, out / name, dpi=160, private=True)
    ]


def key_label(column: str) -> str:
    """Return the label of an axis: `evader.speed_m_s` is "evader speed, m/s"."""
    for ending, unit in (("_m_s", "m/s"), ("_deg", "deg"), ("_hz", "Hz"), ("_m", "m"), ("_s", "s")):
        name, bracket, index = column.partition("[")
        if name.endswith(ending):
            axis = f" {'xyz'[int(index[:-1])]}" if bracket and index[:-1] in {"0", "1", "2"} else ""
            return f"{name.removesuffix(ending).replace('.', ' ').replace('_', ' ')}{axis}, {unit}"
    return column.replace(".", " ").replace("_", " ")


def _figure(title: str, rows: int, columns: int) -> tuple[Figure, Any]:
    figure = figure_of(max(7.0, 3.4 * columns), 1.2 + 3.0 * rows)
    figure.suptitle("\n".join(textwrap.wrap(title, 70)), fontsize=12)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _names(report: Mapping[str, Any], player: str) -> list[str]:
    return list(dict.fromkeys(pair[player] for pair in report["policies"]))


def _styles(report: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    # Wide lines below narrow ones, so that equal curves remain visible.
    return {
        pursuer: {
            **_STYLES[row % len(_STYLES)],
            "linewidth": max(1.0, 3.0 - 0.6 * row),
            "label": pursuer,
            "ms": 4,
        }
        for row, pursuer in enumerate(_names(report, "pursuer"))
    }


def _legend(figure: Figure, axes: Any) -> None:  # noqa: ANN401 - Matplotlib has no types for it
    for panel in axes.ravel():
        panel.grid(visible=True, linewidth=0.3)
    legend_below(figure, *axes.ravel(), columns=3, title="pursuer")


def _regret(report: Mapping[str, Any], regrets: Sequence[Array]) -> Figure | None:
    """Draw the share of games with at most a given regret; one panel for each evader."""
    played_pairs = [one for one in report["policies"] if one["regret_games"]]
    if not played_pairs:
        return None
    evaders = list(dict.fromkeys(pair["evader"] for pair in played_pairs))
    styles = _styles(report)
    figure, axes = _figure(f"{report['title']}: regret against the game's value", 1, len(evaders))
    for panel, evader in zip(axes[0], evaders, strict=True):
        group = [
            (pair, numbers)
            for pair, numbers in zip(played_pairs, regrets, strict=True)
            if pair["evader"] == evader
        ]
        ends = np.quantile(
            np.concatenate([numbers for _, numbers in group]), [1.0 - _SHOWN, _SHOWN]
        )
        margin = max(0.03 * float(np.ptp(ends)), 1e-6)
        for pair, numbers in group:
            quantiles = np.quantile(numbers, _SHARES, method="inverted_cdf")
            panel.plot(
                quantiles, _SHARES, drawstyle="steps-post", markevery=0.2, **styles[pair["pursuer"]]
            )
        panel.set(xlim=(ends[0] - margin, ends[1] + margin), ylim=(0.0, 1.02))
        panel.set(xlabel=f"regret, {report['unit']}", title=f"evader: {evader}")
        panel.axvline(0.0, color="0.5", linewidth=0.8)
    axes[0, 0].set_ylabel("share of games with at most this regret")
    _legend(figure, axes)
    return figure


def _curves(report: Mapping[str, Any], keys: Sequence[Key]) -> Figure | None:
    """Draw regret, and captures if they differ, over every key; one key has a column for each evader."""
    if not keys:
        return None
    evaders = _names(report, "evader")
    styles = _styles(report)
    groups = [
        group
        for policies in report["policies"]
        for key in keys
        for group in policies["by_key"][key.column]
    ]
    differ = len({group["capture"]["estimate"] for group in groups if group["games"]}) > 1
    rows = list(itertools.product(evaders, _MEASURES if differ else _MEASURES[1:]))
    shape = (len(rows) // len(evaders), len(evaders)) if len(keys) == 1 else (len(rows), len(keys))
    figure, axes = _figure(f"{report['title']}: results by swept key", *shape)
    panels = axes.T.ravel() if len(keys) == 1 else axes.ravel()
    for panel, ((evader, (name, count, measure, band)), key) in zip(
        panels, itertools.product(rows, keys), strict=True
    ):
        for one in (pair for pair in report["policies"] if pair["evader"] == evader):
            known_groups = [group for group in one["by_key"][key.column] if group[count]]
            style = styles[one["pursuer"]]
            centres = [
                key.centres[key.labels.index(group["at"][key.column])] for group in known_groups
            ]
            numbers = np.array(
                [[group[measure][part] for part in band] for group in known_groups],
                dtype=np.float64,
            )
            low, middle, high = numbers.reshape(-1, 3).T
            panel.plot(centres, middle, **style)
            panel.fill_between(centres, low, high, color=style["color"], alpha=0.12, linewidth=0.0)
        panel.set(
            xlabel=key_label(key.column),
            ylabel=name.format(report["unit"]),
            title=f"evader: {evader}",
        )
        if measure == "capture":
            panel.set_ylim(-0.03, 1.03)
        if [*key.centres] == [*range(len(key.labels))]:
            panel.set_xticks(key.centres, key.labels)
    _legend(figure, axes)
    return figure


def _map(
    report: Mapping[str, Any], down: Key, across: Key, measure: str, name: str
) -> Figure | None:
    """Draw a measure over two keys, one panel for each pair of policies; None if it is the same everywhere."""
    evaders = _names(report, "evader")
    pursuers = _names(report, "pursuer")
    maps = {}
    for pair in report["policies"]:
        cells = {
            tuple(group["at"].values()): group[measure]["estimate"] for group in pair["by_point"]
        }
        rows = [[cells.get((first, second)) for second in across.labels] for first in down.labels]
        maps[pair["pursuer"], pair["evader"]] = np.array(rows, dtype=np.float64)
    finite_values = np.concatenate([values[np.isfinite(values)] for values in maps.values()])
    if not finite_values.size or not np.ptp(finite_values):
        return None
    figure, axes = _figure(f"{report['title']}: {name}", len(evaders), len(pursuers))
    for (pursuer, evader), values in maps.items():
        panel = axes[evaders.index(evader), pursuers.index(pursuer)]
        image = panel.imshow(
            values,
            origin="lower",
            aspect="auto",
            cmap="cividis",
            vmin=finite_values.min(),
            vmax=finite_values.max(),
        )
        panel.set(
            title=f"{pursuer} / {evader}",
            xlabel=key_label(across.column),
            ylabel=key_label(down.column),
        )
        panel.set_xticks(range(len(across.labels)), across.labels, rotation=45)
        panel.set_yticks(range(len(down.labels)), down.labels)
    figure.colorbar(image, ax=axes, label=name)
    return figure
