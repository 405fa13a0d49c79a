"""Pictures of a sweep: regret, curves over each swept key, maps over two. Dashes and markers tell policies apart."""

import itertools
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from guidance.game.arrays import FloatArray
from guidance.sweeps.axes import Integers
from guidance.viz.figures import figure_of, legend_below, save_twice

_STYLES: Final = (
    {"color": "black", "linestyle": "-", "marker": "o"},
    {"color": "#b3261e", "linestyle": "--", "marker": "s"},
    {"color": "#0b5fa5", "linestyle": ":", "marker": "^"},
    {"color": "#2e7d32", "linestyle": "-.", "marker": "D"},
    {"color": "0.45", "linestyle": (0, (6, 2)), "marker": "v"},
    {"color": "#7b4fa3", "linestyle": (0, (1, 1)), "marker": "x"},
)


class _Measure(NamedTuple):
    """The quantity of the curves.

    Attributes:
        label: With a place for the unit.
        games: Column of the number of games that have the measure.
        column: Of the measure.
        band: Keys of the low end, the middle and the high end of its band.
    """

    label: str
    games: str
    column: str
    band: tuple[str, str, str]


_MEASURES: Final = (
    _Measure(
        "share captured, with its 95 % interval",
        "games",
        "capture",
        ("low", "estimate", "high"),
    ),
    _Measure(
        "regret, {}: median, 5 % to 95 %",
        "regret_games",
        "regret_quantiles",
        ("0.05", "0.5", "0.95"),
    ),
)

_UNITS: Final = {"_m_s": "m/s", "_deg": "deg", "_hz": "Hz", "_m": "m", "_s": "s"}
"""Unit by ending of a key; the first that fits counts."""

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
    report: Mapping[str, Any], keys: Sequence[Key], regrets: Sequence[FloatArray], out: Path
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
    figures = {"regret": _regret(report, regrets)}
    figures["keys"] = _curves(report, keys[:_MOST_KEYS])
    if len(grid) == 2:
        down, across = grid
        regret_label = f"mean regret, {report['unit']}"
        figures["map"] = _map(report, down, across, "regret_mean", regret_label)
        figures["map-captures"] = _map(report, down, across, "capture", "share captured")
    paths: list[Path] = []
    for name, figure in figures.items():
        if figure is not None:
            paths.extend(save_twice(figure, out / name, dpi=160))
    return paths


def key_label(column: str) -> str:
    """Return the label of an axis: `evader.speed_m_s` is "evader speed, m/s"."""
    name = column
    index = ""
    if column.endswith("]"):
        name, _, index = column.removesuffix("]").rpartition("[")
    for ending, unit in _UNITS.items():
        if name.endswith(ending):
            quantity = _spaced(name.removesuffix(ending))
            if index in {"0", "1", "2"}:
                axis = "xyz"[int(index)]
                return f"{quantity} {axis}, {unit}"
            return f"{quantity}, {unit}"
    return _spaced(column)


def _spaced(key: str) -> str:
    return key.replace(".", " ").replace("_", " ")


def titled_figure(title: str, rows: int, columns: int) -> tuple[Figure, Any]:
    """Return a figure with a title, and its axes, (rows, columns)."""
    width_inches = max(7.0, 3.4 * columns)
    height_inches = 1.2 + 3.0 * rows
    figure = figure_of(width_inches, height_inches)
    wrapped_title = "\n".join(textwrap.wrap(title, 70))
    figure.suptitle(wrapped_title, fontsize=12)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _names(report: Mapping[str, Any], player: str) -> list[str]:
    names = [pair[player] for pair in report["policies"]]
    return list(dict.fromkeys(names))


def _styles(report: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    styles = {}
    for number, pursuer in enumerate(_names(report, "pursuer")):
        # Wide lines below narrow ones, so that equal curves remain visible.
        width = max(1.0, 3.0 - 0.6 * number)
        style = _STYLES[number % len(_STYLES)]
        styles[pursuer] = {**style, "linewidth": width, "label": pursuer, "ms": 4}
    return styles


def _legend(figure: Figure, axes: Any) -> None:  # noqa: ANN401 - Matplotlib has no types for it
    for panel in axes.ravel():
        panel.grid(visible=True, linewidth=0.3)
    legend_below(figure, *axes.ravel(), columns=3, title="pursuer")


def _regret(report: Mapping[str, Any], regrets: Sequence[FloatArray]) -> Figure | None:
    """Draw the share of games with at most a given regret; one panel for each evader."""
    regrets = [numbers for numbers in regrets if numbers.size]
    played_pairs = [pair for pair in report["policies"] if pair["regret_games"]]
    if not played_pairs:
        return None
    evaders = list(dict.fromkeys(pair["evader"] for pair in played_pairs))
    styles = _styles(report)
    title = f"{report['title']}: regret against the game's value"
    figure, axes = titled_figure(title, 1, len(evaders))
    for panel, evader in zip(axes[0], evaders, strict=True):
        of_pursuers = [
            (pair["pursuer"], numbers)
            for pair, numbers in zip(played_pairs, regrets, strict=True)
            if pair["evader"] == evader
        ]
        for pursuer, numbers in of_pursuers:
            quantiles = np.quantile(numbers, _SHARES, method="inverted_cdf")
            style = styles[pursuer]
            panel.plot(quantiles, _SHARES, drawstyle="steps-post", markevery=0.2, **style)
        all_regrets = np.concatenate([numbers for _, numbers in of_pursuers])
        # The limits show nearly all regrets, with a margin.
        low, high = np.quantile(all_regrets, [1.0 - _SHOWN, _SHOWN]).tolist()
        margin = max(0.03 * (high - low), 1e-6)
        panel.set(xlim=(low - margin, high + margin), ylim=(0.0, 1.02))
        panel.axvline(0.0, color="0.5", linewidth=0.8)
        panel.set(xlabel=f"regret, {report['unit']}", title=f"evader: {evader}")
    axes[0, 0].set_ylabel("share of games with at most this regret")
    _legend(figure, axes)
    return figure


def _curves(report: Mapping[str, Any], keys: Sequence[Key]) -> Figure | None:
    """Draw regret, and captures if they differ, over every key; one key has a column for each evader."""
    if not keys:
        return None
    evaders = _names(report, "evader")
    styles = _styles(report)
    # Captures are drawn only if their share is not the same for all pairs and groups.
    shares = set()
    for policies in report["policies"]:
        for key in keys:
            groups = policies["by_key"][key.column]
            shares |= {group["capture"]["estimate"] for group in groups if group["games"]}
    measures = _MEASURES if len(shares) > 1 else _MEASURES[1:]
    title = f"{report['title']}: results by swept key"
    if len(keys) == 1:
        figure, axes = titled_figure(title, len(measures), len(evaders))
        panels = axes.T.ravel()
    else:
        figure, axes = titled_figure(title, len(evaders) * len(measures), len(keys))
        panels = axes.ravel()
    contents = itertools.product(evaders, measures, keys)
    for panel, (evader, measure, key) in zip(panels, contents, strict=True):
        for pair in report["policies"]:
            if pair["evader"] == evader:
                groups = pair["by_key"][key.column]
                style = styles[pair["pursuer"]]
                centres = []
                bands = []
                for group in groups:
                    if not group[measure.games]:
                        continue
                    number = key.labels.index(group["at"][key.column])
                    centres.append(key.centres[number])
                    values = group[measure.column]
                    bands.append([values[part] for part in measure.band])
                bands_of_groups = np.array(bands, dtype=np.float64).reshape(-1, 3)
                low, middle, high = bands_of_groups.T
                panel.plot(centres, middle, **style)
                panel.fill_between(
                    centres, low, high, color=style["color"], alpha=0.12, linewidth=0.0
                )
        panel.set(xlabel=key_label(key.column), ylabel=measure.label.format(report["unit"]))
        if measure.column == "capture":
            panel.set_ylim(-0.03, 1.03)
        numbers = list(range(len(key.labels)))
        if list(key.centres) == numbers:
            panel.set_xticks(key.centres, key.labels)
        panel.set_title(f"evader: {evader}")
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
        # NaN where the measure is unknown.
        groups = pair["by_point"]
        cells = {}
        for group in groups:
            labels = tuple(group["at"].values())
            cells[labels] = group[measure]["estimate"]
        points = itertools.product(down.labels, across.labels)
        grid = np.array([cells.get(point) for point in points], dtype=np.float64)
        maps[pair["pursuer"], pair["evader"]] = grid.reshape(len(down.labels), len(across.labels))
    finite_values = np.concatenate([values[np.isfinite(values)] for values in maps.values()])
    if not finite_values.size or not np.ptp(finite_values):
        return None
    colours = {"cmap": "cividis", "vmin": finite_values.min(), "vmax": finite_values.max()}
    title = f"{report['title']}: {name}"
    figure, axes = titled_figure(title, len(evaders), len(pursuers))
    for (pursuer, evader), values in maps.items():
        panel = axes[evaders.index(evader), pursuers.index(pursuer)]
        image = panel.imshow(values, origin="lower", aspect="auto", **colours)
        panel.set(
            title=f"{pursuer} / {evader}",
            xlabel=key_label(across.column),
            ylabel=key_label(down.column),
        )
        panel.set_xticks(range(len(across.labels)), across.labels, rotation=45)
        panel.set_yticks(range(len(down.labels)), down.labels)
    figure.colorbar(image, ax=axes, label=name)
    return figure
