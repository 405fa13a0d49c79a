"""`guidance solve`: who wins a game from one state, where, when and how; or from every row of a file.

`guidance paper`: the published tables and figures, computed again.
"""

import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from guidance.cli.arguments import AsJson, refuse
from guidance.errors import ConfigError
from guidance.extras import require_extras
from guidance.files import writing
from guidance.game import Ball, Cylinder, Game, Reason, Solution, SpeedSet, StandOff, Winner
from guidance.game import solve as solve_game
from guidance.screen import console, pairs, text_table


def solve(
    ctx: typer.Context,
    pursuer: Annotated[str | None, typer.Option(help="Position x,y,z of the pursuer, m.")] = None,
    evader: Annotated[str | None, typer.Option(help="Position x,y of the evader, m.")] = None,
    target: Annotated[
        str | None, typer.Option(help="Position x,y of the evader's target, m: the TAD game.")
    ] = None,
    speed_ratio: Annotated[
        float | None, typer.Option(help="δ = u/v, more than 1: the paper's speed set.")
    ] = None,
    evader_speed: Annotated[float, typer.Option(help="Speed bound v of the evader, m/s.")] = 1.0,
    cylinder: Annotated[
        str | None, typer.Option(help="Not the ratio: speeds level,climb,descent, m/s.")
    ] = None,
    standoff: Annotated[
        str, typer.Option(help="Radius and height R,h of the stand-off disc, m.")
    ] = "0,0",
    as_json: AsJson = False,
    states: Annotated[
        Path | None, typer.Option(help="CSV or Parquet file with a state in each row.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="CSV or Parquet file for the answers to --states.")
    ] = None,
) -> None:
    """Solve one state, or every row of a file.

    A file has the columns pursuer_x_m, pursuer_y_m, pursuer_z_m, evader_x_m and evader_y_m, for the TAD game target_x_m
    and target_y_m as well, and optionally speed_ratio. The answers are appended as columns. A row without an answer
    has NaN and a reason; "not_a_number" means that a cell holds text.

    A file of teams has the columns pursuer_0_x_m, pursuer_0_y_m, pursuer_0_z_m, pursuer_1_x_m … and evader_0_x_m,
    evader_0_y_m, evader_1_x_m …; the cells of an absent player are empty. The answers give the number of guaranteed
    captures, the matching, and the velocity of every player.

    - `guidance solve --pursuer 8,1.42,9.41 --evader 7.92,9.6 --speed-ratio 2`: the paper's PE state
    - `guidance solve --pursuer 40,0,30 --evader 9,2 --target 0,0 --cylinder 12,3,1.5 --evader-speed 3 --standoff 3,5`:
      a multicopter that keeps an evader from a target
    - `guidance solve --states states.csv --out answers.parquet --speed-ratio 2`: a file of states
    """
    if (speed_ratio is None) == (cylinder is None) and (states is None or cylinder is not None):
        raise ConfigError("--speed-ratio, --cylinder: exactly one of them must be given")
    if not (math.isfinite(evader_speed) and evader_speed > 0):
        raise ConfigError(f"--evader-speed = {evader_speed!r}: must be a finite number above 0")
    if speed_ratio is not None and not (math.isfinite(speed_ratio) and speed_ratio > 1):
        raise ConfigError(f"--speed-ratio = {speed_ratio!r}: must be a finite number above 1")
    # With neither, a file of states has the ratio of each row.
    speeds: SpeedSet = Ball((2.0 if speed_ratio is None else speed_ratio) * evader_speed)
    if cylinder is not None:
        speeds = Cylinder(*_numbers("--cylinder", cylinder, 3))
    disc = StandOff(*_numbers("--standoff", standoff, 2))
    game = Game(speeds, evader_speed, standoff=disc)
    if states is not None:
        refuse(ctx, "--states", "for one state", "--pursuer", "--evader", "--target", "--json")
        require_extras("--states", "sim")
        from guidance.sweeps.states import solve_file  # noqa: PLC0415 - pyarrow is optional

        speeds_given = speed_ratio is not None or cylinder is not None
        solve_file(game, states, out, speeds_given=speeds_given)
        return
    refuse(ctx, "one state", "with --states", "--out")
    if pursuer is None or evader is None:
        raise ConfigError("--pursuer, --evader: both must be given, or --states")
    P = _numbers("--pursuer", pursuer, 3)
    E = (*_numbers("--evader", evader, 2), 0.0)
    T: tuple[float, ...] | None = None
    if target is not None:
        T = (*_numbers("--target", target, 2), 0.0)
    answer = solve_game(game, P, E, T)
    if as_json:
        # JSON has no infinity and no NaN: they become null.
        fields = {}
        for name, field in answer._asdict().items():
            numbers = np.where(np.isfinite(field), field, np.array(None))
            fields[name] = numbers.tolist()
        fields["winner"] = Winner(int(answer.winner)).word
        fields["reason"] = Reason(int(answer.reason)).word
        record = json.dumps(fields)
        sys.stdout.write(record + "\n")
    else:
        rows = _rows(answer, with_target=target is not None)
        console().print(pairs(rows))


def _numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    """Read numbers separated by commas."""
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    are_finite = all(math.isfinite(number) for number in numbers)
    if len(numbers) != count or not are_finite:
        allowed = f"must be {count} finite numbers separated by commas"
        raise ConfigError(f"{option} = {text!r}: {allowed}")
    return numbers


def _rows(answer: Solution, *, with_target: bool) -> Iterator[tuple[str, str]]:
    """Yield the names and values of an answer for people."""
    winner = Winner(int(answer.winner))
    value = f"{float(answer.value):.4f}"
    yield "winner", winner.word
    if not with_target:
        yield "time to capture, s", value
        yield "margin, s", "none: without a target it always captures"
    else:
        meaning = "final distance to the target, m"
        if winner < 0:
            meaning = "pursuer short of a capture by, m"
        yield meaning, value
        yield "margin, s", f"{float(answer.margin_s):.4f}"
    yield "meeting point, m", _vector(answer.meeting_point_m)
    yield "meeting time, s", f"{float(answer.meeting_time_s):.4f}"
    yield "pursuer's velocity, m/s", _vector(answer.pursuer_velocity_m_s)
    yield "evader's velocity, m/s", _vector(answer.evader_velocity_m_s)
    reason = Reason(int(answer.reason))
    yield "reason", reason.word.replace("_", " ")


def _vector(vector: Any) -> str:  # noqa: ANN401 - an array of any library
    return ", ".join(f"{float(part):.4f}" for part in vector)


def paper(
    out: Annotated[Path, typer.Option(help="Folder for the figures (PNG and PDF).")] = Path(
        "paper"
    ),
    figures: Annotated[bool, typer.Option(help="Draw the figures.")] = True,
    as_json: AsJson = False,
) -> None:
    """Recompute the paper's tables and figures; the exit code is 1 if a published digit differs."""
    from guidance.paper import draw_figures, tables  # noqa: PLC0415

    if figures:
        require_extras("the figures (--no-figures leaves them out)", "plot")
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
    target = console(stderr=as_json)
    computed = tables()
    matches = list[bool]()
    rows = []
    for table in computed:
        names = {"title": table.title, "quantity": table.quantity}
        rows += [names | case.plain for case in table.cases]
        matches += [case.matches for case in table.cases]
    if as_json:
        typer.echo(json.dumps(rows, indent=2))
    else:
        for table in computed:
            headings = ("pursuer", "evader", "published", "paper's stepping", "exact", "match")
            cells = []
            for case in table.cases:
                mark = "✓" if case.matches else "✗"
                cells.append((*case.policies, case.published, case.stepped, case.exact, mark))
            title = f"{table.title}; {table.quantity}"
            target.print(text_table(headings, cells, left=(0, 1), title=title))
        right = matches.count(True)
        target.print(f"{right} of {len(matches)} published cells match in every digit.")
    if figures:
        for path in draw_figures(*computed, out):
            target.print(f"drawn: {path}", soft_wrap=True)
    if not all(matches):
        raise typer.Exit(1)
