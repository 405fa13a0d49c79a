"""Results of a league: a table on the screen, JSON, a picture, and the worst states as scenario files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomlkit
from rich.console import Console

from guidance.errors import ConfigError
from guidance.files import private_folder, whole_file, writing
from guidance.league.contest import (
    Contest,
    IntervalEstimate,
    PlayedPair,
    scenario_of_game,
    worst_rows,
)
from guidance.league.frpn import FRPN, FRPN_LEVEL
from guidance.screen import print_text_table
from guidance.sim.scenario import PURSUER

TABLE: Final = "league.json"
_PICTURE: Final = "league.png"

_DASH_DOT: Final = (0, (5, 1, 1, 1))
_DASH_DOT_DOT: Final = (0, (3, 1, 1, 1, 1, 1))
_LONG_DASH: Final = (0, (8, 3))
_STYLES: Final = ("-", "--", "-.", ":", _DASH_DOT, _DASH_DOT_DOT, _LONG_DASH)
_SHARES: Final = np.linspace(0.0, 1.0, 201)


def unit_of(contest: Contest) -> str:
    """Return the unit of the regret."""
    return "s" if contest.scenario.target is None else "m"


def label_of(policy: str) -> str:
    """Return the short name of a law of the league, else the policy's name."""
    return "frpn" if policy in {FRPN, FRPN_LEVEL} else policy


def print_table(target: Console, contest: Contest, played: Sequence[PlayedPair]) -> None:
    """Print a row for each pair."""
    unit = unit_of(contest)
    measures = [f"regret, median {unit}", f"95 % {unit}", f"worst {unit}"]
    headings = [contest.side, "against", "won %", *measures]
    in_pe = contest.scenario.target is None
    if in_pe:
        headings.append("median, % of the value")
    headings.append("failed")
    cells = []
    for pair in played:
        row = pair.row
        won = _words(row.won, 100.0)
        regrets = [_words(row.median), _words(row.p95), f"{row.worst:.2f}"]
        line = [label_of(row.player), label_of(row.opponent), won, *regrets]
        if in_pe:
            line.append(_words(row.relative, 100.0))
        line.append(str(row.failed))
        cells.append(line)
    print_text_table(target, headings, cells, left=range(2))


def _words(estimate: IntervalEstimate, scale: float = 1.0) -> str:
    value, low, high = (scale * number + 0.0 for number in estimate)
    return f"{value:.2f} [{low:.2f}, {high:.2f}]"


def document_of(contest: Contest, played: Sequence[PlayedPair]) -> dict[str, Any]:
    """Return the results as plain values; None where there is no number."""
    scenario = contest.scenario
    rows = [_plain(pair.row._asdict()) for pair in played]
    return {
        "scenario": scenario.title,
        "game": scenario.game,
        "side": contest.side,
        "games": len(contest.states.seed),
        "seed": contest.seed,
        "unit": unit_of(contest),
        "confidence": 0.95,
        "rows": rows,
    }


def _plain(value: Any) -> Any:  # noqa: ANN401 - a value of a row
    if isinstance(value, IntervalEstimate):
        return _plain(value._asdict())
    if isinstance(value, Mapping):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, float):
        return round(value, 9) + 0.0 if np.isfinite(value) else None
    return value


def require_new(out: Path) -> None:
    """Check the folder of the results.

    Raises:
        ConfigError: If it has results already.
    """
    for name in (TABLE, _PICTURE):
        if (out / name).exists():
            raise ConfigError(f"--out {out}: contains another league ({name}); give a new folder")


def write_table(out: Path, text: str) -> Path:
    """Write the table; return its path.

    Raises:
        OutputError: If it cannot be written.
    """
    table = out / TABLE
    with writing(f"--out {out}"):
        private_folder(out)
        _write(table, text)
    return table


def write_results(
    contest: Contest, played: Sequence[PlayedPair], out: Path, text: str, worst: int
) -> list[Path]:
    """Write table, picture and worst states of the first player; return their paths.

    Raises:
        OutputError: If they cannot be written.
    """
    first_player = contest.players[0]
    pairs = [pair for pair in played if pair.row.player == first_player]
    table = write_table(out, text)
    with writing(f"--out {out}"):
        picture = draw_regrets(contest, played, out / _PICTURE)
        paths = [table, picture]
        for pair in pairs:
            row = pair.row
            for place, number in enumerate(worst_rows(pair, worst), 1):
                scenario = scenario_of_game(contest, row, number)
                document = scenario.model_dump(
                    mode="json", exclude={"expect"}, exclude_unset=True, exclude_none=True
                )
                document["seed"] = scenario.seed
                game = f"Game {number} of a league with seed {contest.seed}"
                players = f"{row.player} against {row.opponent}"
                regret = f"{pair.regret[number]:.3f} {unit_of(contest)}"
                document["description"] = f"{game}: {players}, regret {regret}."
                _, _, opponent = row.opponent.rpartition(":")
                path = out / f"worst-{opponent}-{place}.toml"
                _write(path, tomlkit.dumps(document))
                paths.append(path)
    return paths


def _write(path: Path, text: str) -> None:
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")


def draw_regrets(contest: Contest, played: Sequence[PlayedPair], path: Path) -> Path:
    """Draw the share of games with at most a given regret; a panel for each opponent, a line for each player."""
    from guidance.viz.figures import figure_of, legend_below, save  # noqa: PLC0415 - matplotlib is optional

    columns = len(contest.opponents)
    width_inches = max(7.0, 3.4 * columns)
    figure = figure_of(width_inches, 4.4)
    opposing_side = "evader" if contest.side == PURSUER else "pursuer"
    figure.suptitle(f"{contest.scenario.title}: regret of the {contest.side}", fontsize=12)
    axes = figure.subplots(1, columns, squeeze=False)
    for panel, opponent in zip(axes[0], contest.opponents, strict=True):
        pairs = [pair for pair in played if pair.row.opponent == opponent]
        # The axis leaves out the last 2 % at both ends.
        for number, pair in enumerate(pairs):
            style = _STYLES[number % len(_STYLES)]
            width = max(1.0, 3.0 - 0.4 * number)
            values = np.quantile(pair.regret, _SHARES)
            label = label_of(pair.row.player)
            panel.plot(values, _SHARES, label=label, linestyle=style, linewidth=width)
        regrets = np.concatenate([pair.regret for pair in pairs])
        low, high = np.quantile(regrets, (0.02, 0.98)).tolist()
        margin = max(0.03 * (high - low), 1e-6)
        panel.set(xlim=(low - margin, high + margin), ylim=(0.0, 1.02))
        panel.axvline(0.0, color="0.5", linewidth=0.8)
        panel.grid(visible=True, linewidth=0.3)
        title = f"{opposing_side}: {label_of(opponent)}"
        panel.set(xlabel=f"regret, {unit_of(contest)}", title=title)
    axes[0, 0].set_ylabel("share of games with at most this regret")
    legend_below(figure, *axes.ravel(), columns=3, title=contest.side)
    save(figure, path)
    return path
