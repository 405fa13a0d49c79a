"""How the pictures of a report look: told apart by dashes and markers, not by colour alone."""

from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from guidance.report.story import Array, Story

PURSUER: Final = {"color": "#b3261e", "linewidth": 1.8}
EVADER: Final = {"color": "#0b5fa5", "linewidth": 1.8, "linestyle": "--"}
BEFORE: Final = {"color": "0.6", "linewidth": 0.9}
FENCE: Final = {"color": "0.1", "linewidth": 1.2, "linestyle": (0, (8, 3, 1, 3))}
STANDOFF: Final = {"color": "#2e7d32", "linewidth": 1.3, "linestyle": "-."}
ISOCHRON: Final = {"color": "0.25", "linewidth": 1.1, "linestyle": ":"}
ISOCHRON_LATER: Final = {"color": "0.25", "linewidth": 1.6, "linestyle": (0, (1, 1))}
MARK: Final = {"color": "0.35", "linewidth": 0.8, "linestyle": (0, (2, 2))}

MOST_POINTS: Final = 3000
"""A curve has no more points than this: a page is looked at, not measured."""


def figure_of(width: float, height: float) -> Figure:
    """Return an empty figure, inches."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def thinned(values: Array) -> Array:
    """Leave out points of a long curve evenly, keeping both ends."""
    if len(values) <= MOST_POINTS:
        return values
    kept: Array = values[np.linspace(0, len(values) - 1, MOST_POINTS).round().astype(int)]
    return kept


def panels(figure: Figure, count: int) -> list[Any]:
    """Return axes above each other on one time axis, with a thin grid."""
    axes = list(np.atleast_1d(figure.subplots(count, 1, sharex=True)))
    for one in axes:
        one.grid(visible=True, linewidth=0.3)
        one.margins(x=0.01)
    axes[-1].set_xlabel("time, s")
    return axes


def mark_moments(axes: list[Any], story: Story) -> None:
    """Draw where the game began and where the disc was reached, named above the first panel."""
    for cycle, name in ((story.engaged, "engaged"), (story.captured, "captured")):
        if cycle is None:
            continue
        now_s = story.cycles[cycle].now_s
        for one in axes:
            one.axvline(now_s, **MARK)
        axes[0].text(now_s, 1.01, name, transform=axes[0].get_xaxis_transform(), ha="center", va="bottom", fontsize=9)


def legend_beside(axes: Any) -> None:  # noqa: ANN401 - matplotlib's axes
    """Put the legend outside, where it covers nothing."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.005, 1.0), borderaxespad=0.0, frameon=False, fontsize=9)


def playing_span(story: Story) -> slice:
    """The cycles from a little before the game to a little after the capture; all, where there was no game."""
    if story.engaged is None:
        return slice(None)
    last = max(number for number, one in enumerate(story.certificates) if one is not None)
    return slice(max(0, story.engaged - 50), min(len(story.cycles), last + 50))
