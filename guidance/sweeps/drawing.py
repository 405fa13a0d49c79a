"""Pictures of a sweep: regret, capture and the worst cases. Dashes, markers and hatches tell policies apart."""

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from guidance.files import private_file
from guidance.sweeps.statistics import share
from guidance.sweeps.tally import Tally, Worst
from guidance.viz.figures import figure_of

_DPI: Final = 160
_STYLES: Final = (
    {"color": "black", "linestyle": "-", "marker": "o"},
    {"color": "#b3261e", "linestyle": "--", "marker": "s"},
    {"color": "#0b5fa5", "linestyle": ":", "marker": "^"},
    {"color": "#2e7d32", "linestyle": "-.", "marker": "D"},
    {"color": "0.45", "linestyle": (0, (6, 2)), "marker": "v"},
    {"color": "#7b4fa3", "linestyle": (0, (1, 1)), "marker": "x"},
)
_HATCHES: Final = ("", "///", "...", "xxx", "\\\\\\", "++")
_MOST_KEYS: Final = 6
_POINTS: Final = 400
_SHOWN: Final = 0.995
"""The regret's axis ends here, and what is beyond is said: a single game would else flatten all the others."""


def draw_all(tallies: Sequence[Tally], worst: Sequence[Worst], *, title: str, unit: str, out: Path) -> list[Path]:
    """Draw every picture that there is something for, as PNG and PDF, and return their paths.

    Args:
        tallies: One a pair of policies.
        worst: The rows that went worst.
        title: Of the sweep.
        unit: Of the regret, `s` or `m`.
        out: The folder.

    Raises:
        OSError: If a file cannot be written.
    """
    figures = {"capture": _capture(tallies, title), "regret": _regret(tallies, title, unit)}
    figures["worst"] = _worst(worst, title, unit)
    paths = []
    for name, figure in figures.items():
        if figure is None:
            continue
        for kind in ("png", "pdf"):
            path = out / f"{name}.{kind}"
            figure.savefig(private_file(path), dpi=_DPI, metadata={"CreationDate": None} if kind == "pdf" else None)
            figure.set_layout_engine(None)  # it is laid out now
            paths.append(path)
    return paths


def key_label(column: str) -> str:
    """Name an axis: `evader.speed_m_s` is "evader speed, m/s"."""
    for ending, unit in (("_m_s", "m/s"), ("_deg", "deg"), ("_hz", "Hz"), ("_m", "m"), ("_s", "s")):
        name, bracket, place = column.partition("[")
        if name.endswith(ending):
            axis = f" {'xyz'[int(place[:-1])]}" if bracket and place[:-1] in {"0", "1", "2"} else ""
            return f"{name.removesuffix(ending).replace('.', ' ').replace('_', ' ')}{axis}, {unit}"
    return column.replace(".", " ").replace("_", " ")


def _figure(title: str, rows: int, columns: int) -> tuple[Figure, Any]:
    figure = figure_of(max(7.0, 3.4 * columns), 1.2 + 3.0 * rows)
    figure.suptitle("\n".join(textwrap.wrap(title, 80)), fontsize=12)
    axes = figure.subplots(rows, columns, squeeze=False)
    for one in axes.ravel():
        one.grid(visible=True, linewidth=0.3)
    return figure, axes


def _by_evader(tallies: Sequence[Tally]) -> Iterator[tuple[str, list[Tally]]]:
    for evader in dict.fromkeys(tally.pair.evader for tally in tallies):
        yield str(evader), [tally for tally in tallies if tally.pair.evader == evader]


def _styles(tallies: Sequence[Tally]) -> Mapping[str | None, dict[str, Any]]:
    pursuers = dict.fromkeys(tally.pair.pursuer for tally in tallies)
    # Broad lines below narrow ones, so that one on top of another shows both.
    return {
        pursuer: {**_STYLES[place % len(_STYLES)], "linewidth": max(1.0, 3.0 - 0.6 * place)}
        for place, pursuer in enumerate(pursuers)
    }


def _legend(figure: Figure, axes: Any) -> None:  # noqa: ANN401 - matplotlib's axes
    named: dict[str, Any] = {}
    for one in axes.ravel():
        named |= dict(zip(*reversed(one.get_legend_handles_labels()), strict=True))
    figure.legend(
        named.values(), named, loc="outside lower center", ncols=3, frameon=False, fontsize=9, title="pursuer"
    )


def _regret(tallies: Sequence[Tally], title: str, unit: str) -> Figure | None:
    """How large a share of the games had at most so much regret; one panel for each evader."""
    known = [tally for tally in tallies if tally.regret.count]
    if not known:
        return None
    groups, styles = list(_by_evader(known)), _styles(known)
    figure, axes = _figure(f"{title}: regret against the game's value", 1, len(groups))
    for one, (evader, group) in zip(axes[0], groups, strict=True):
        sorted_regrets = {tally.pair.pursuer: tally.sorted_regrets() for tally in group}
        ends = np.quantile(np.concatenate(list(sorted_regrets.values())), [1.0 - _SHOWN, _SHOWN])
        margin = max(0.03 * float(np.ptp(ends)), 1e-6)
        for pursuer, regrets in sorted_regrets.items():
            at = np.unique(np.linspace(0, len(regrets) - 1, _POINTS).round().astype(int))
            shares = (at + 1.0) / len(regrets)
            one.plot(regrets[at], shares, drawstyle="steps-post", label=pursuer, markevery=0.2, ms=4, **styles[pursuer])
        one.set(xlim=(ends[0] - margin, ends[1] + margin), ylim=(0.0, 1.02))
        one.set(xlabel=f"regret, {unit}", title=f"evader: {evader}")
        one.axvline(0.0, color="0.5", linewidth=0.8)
    axes[0, 0].set_ylabel("share of games with at most this regret")
    _legend(figure, axes)
    return figure


def _capture(tallies: Sequence[Tally], title: str) -> Figure | None:
    """The probability of capture over every key that it depends on, one row for each evader; or bars, if on none."""
    bins = tallies[0].bins
    if not bins:
        return None
    telling = [number for number in range(len(bins)) if _differs(tallies, number)][:_MOST_KEYS]
    if not telling:
        return _capture_bars(tallies, title)
    groups, styles = list(_by_evader(tallies)), _styles(tallies)
    figure, axes = _figure(f"{title}: probability of capture, with 95 % intervals", len(groups), len(telling))
    for row, (evader, group) in zip(axes, groups, strict=True):
        for number, one in zip(telling, row, strict=True):
            each = bins[number]
            for place, tally in enumerate(group):
                _capture_line(one, tally, number, place - 0.5 * (len(group) - 1), styles[tally.pair.pursuer])
            one.set(ylim=(-0.03, 1.03), xlabel=key_label(each.column))
            if any(isinstance(value, str) for value in each.values):
                one.set_xticks(each.centres, each.labels)
        row[0].set_ylabel(f"captured\nevader: {evader}")
    _legend(figure, axes)
    return figure


def _differs(tallies: Sequence[Tally], number: int) -> bool:
    """Whether the probability of capture depends on a key: for some pair, two intervals have nothing in common."""
    for tally in tallies:
        counts = zip(tally.captures[number], tally.games[number], strict=True)
        intervals = [share(int(captures), int(games)) for captures, games in counts if games]
        if intervals and max(one.low for one in intervals) > min(one.high for one in intervals):
            return True
    return False


def _capture_bars(tallies: Sequence[Tally], title: str) -> Figure:
    """The probability of capture of every pair, a bar each: no swept key makes a difference to it."""
    figure, axes = _figure(f"{title}: probability of capture, with 95 % intervals", 1, 1)
    figure.set_size_inches(8.5, 1.9 + 0.3 * len(tallies))
    one = axes[0, 0]
    for place, tally in enumerate(tallies):
        found = share(tally.ends["captured"], tally.valid)
        reach = [[max(0.0, found.estimate - found.low)], [max(0.0, found.high - found.estimate)]]
        one.barh(place, found.estimate, xerr=reach, color="0.85", edgecolor="black", capsize=3)
    one.set_yticks(range(len(tallies)), [f"{tally.pair.pursuer} / {tally.pair.evader}" for tally in tallies])
    one.set(
        xlim=(0.0, 1.03), xlabel="captured (no swept key makes a difference that is seen)", ylabel="pursuer / evader"
    )
    one.invert_yaxis()
    return figure


def _capture_line(axes: Any, tally: Tally, number: int, aside: float, style: Mapping[str, Any]) -> None:  # noqa: ANN401
    """Draw one policy's line, a little aside of the others' so that all intervals are seen."""
    counted = [
        (centre, share(int(captures), int(games)))
        for centre, captures, games in zip(
            tally.bins[number].centres, tally.captures[number], tally.games[number], strict=True
        )
        if games
    ]
    if not counted:
        return
    shift = 0.008 * aside * float(np.ptp([centre for centre, _ in counted]))
    x = [centre + shift for centre, _ in counted]
    y = np.array([interval for _, interval in counted])
    reach = np.abs(y[:, 1:] - y[:, :1]).T
    axes.errorbar(x, y[:, 0], yerr=reach, label=tally.pair.pursuer, ms=4, capsize=2, elinewidth=1.0, **style)


def _worst(worst: Sequence[Worst], title: str, unit: str) -> Figure | None:
    """The worst cases' regret, a bar a file; one that was lost has no regret and is said so."""
    if not worst:
        return None
    figure, axes = _figure(f"{title}: the worst cases", 1, 1)
    figure.set_size_inches(8.5, 1.6 + 0.28 * len(worst))
    one = axes[0, 0]
    pursuers = list(dict.fromkeys(case.tally.pair.pursuer for case in worst))
    for place, case in enumerate(worst):
        hatch = _HATCHES[pursuers.index(case.tally.pair.pursuer) % len(_HATCHES)]
        lost = np.isnan(case.regret)
        one.barh(place, 0.0 if lost else case.regret, color="0.85", edgecolor="black", hatch=hatch)
        if lost:
            one.text(0.0, place, f" not captured: {case.end}", va="center", fontsize=8)
    names = [f"{case.path.stem}: {case.tally.pair.pursuer} / {case.tally.pair.evader}" for case in worst]
    one.set_yticks(range(len(worst)), names, fontsize=8)
    one.invert_yaxis()
    one.set_xlabel(f"regret, {unit}")
    return figure
