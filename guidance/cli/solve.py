"""`guidance solve`: who wins a state of a game, where, when and how; or a whole file of states."""

import math
from pathlib import Path
from typing import Annotated

import typer

from guidance.cli.arguments import refuse_others
from guidance.errors import ConfigError
from guidance.extras import require


def solve(
    pursuer: Annotated[str | None, typer.Option(help="Position x,y,z of the pursuer, m.")] = None,
    evader: Annotated[str | None, typer.Option(help="Position x,y of the evader, m.")] = None,
    target: Annotated[str | None, typer.Option(help="Position x,y of the evader's target, m: the TAD game.")] = None,
    speed_ratio: Annotated[float | None, typer.Option(help="δ = u/v, more than 1: the paper's speed set.")] = None,
    evader_speed: Annotated[float, typer.Option(help="Speed bound v of the evader, m/s.")] = 1.0,
    cylinder: Annotated[
        str | None, typer.Option(help="Speeds horizontal,climb,descent, m/s, in place of the speed ratio.")
    ] = None,
    standoff: Annotated[str, typer.Option(help="Radius and height R,h of the stand-off disc, m.")] = "0,0",
    capture_radius: Annotated[float, typer.Option(help="Distance from the disc that counts as capture, m.")] = 0.0,
    information_age: Annotated[float, typer.Option(help="Age of the evader's position, s.")] = 0.0,
    wind: Annotated[str, typer.Option(help="Velocity x,y of the air, m/s.")] = "0,0",
    target_velocity: Annotated[str, typer.Option(help="Velocity x,y of the target, m/s, which it keeps.")] = "0,0",
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    states: Annotated[Path | None, typer.Option(help="CSV or Parquet file with a state in each row.")] = None,
    out: Annotated[Path | None, typer.Option(help="CSV or Parquet file for the answers to --states.")] = None,
    chunk: Annotated[
        int | None, typer.Option(help="Rows of --states solved and written at a time.", min=1, show_default="65536")
    ] = None,
) -> None:
    """Solve one state, or every row of a file.

    A file has the columns pursuer_x_m, pursuer_y_m, pursuer_z_m, evader_x_m and evader_y_m, for the TAD game target_x_m
    and target_y_m as well, and may have speed_ratio. The answers are appended as columns; a row without an answer has
    NaN and its reason, also where a cell should be a number and is not.

    A file of teams has the columns pursuer_0_x_m, pursuer_0_y_m, pursuer_0_z_m, pursuer_1_x_m … and evader_0_x_m,
    evader_0_y_m, evader_1_x_m …; who is not there in a row has empty cells. The answers say how many captures are
    guaranteed, who captures whom, and every player's velocity.

    - `guidance solve --pursuer 8,1.42,9.41 --evader 7.92,9.6 --speed-ratio 2`: the paper's PE state
    - `guidance solve --pursuer 40,0,30 --evader 9,2 --target 0,0 --cylinder 12,3,1.5 --evader-speed 3 --standoff 3,5`:
      a multicopter that keeps an evader from a target
    - `guidance solve --states states.csv --out answers.parquet --speed-ratio 2`: a file of states
    """
    from guidance.cli.solve_state import solve_state  # noqa: PLC0415 - NumPy takes a third of a second
    from guidance.game import Ball, Cylinder, Game, StandOff  # noqa: PLC0415

    if (speed_ratio is None) == (cylinder is None) and (states is None or cylinder is not None):
        raise ConfigError("--speed-ratio, --cylinder: exactly one of them must be given")
    if not (math.isfinite(evader_speed) and evader_speed > 0):
        raise ConfigError(f"--evader-speed = {evader_speed!r}: must be a finite number above 0")
    if speed_ratio is not None and not (math.isfinite(speed_ratio) and speed_ratio > 1):
        raise ConfigError(f"--speed-ratio = {speed_ratio!r}: must be a finite number above 1")
    radius, height = _numbers("--standoff", standoff, 2)
    game = Game(
        Cylinder(*_numbers("--cylinder", cylinder, 3)) if cylinder else Ball((speed_ratio or 2.0) * evader_speed),
        evader_speed,
        capture_radius_m=capture_radius,
        standoff=StandOff(radius, height),
        information_age_s=information_age,
        wind_m_s=_pair("--wind", wind),
        target_velocity_m_s=_pair("--target-velocity", target_velocity),
    )
    single = {"--pursuer": pursuer, "--evader": evader, "--target": target, "--json": as_json}
    if states is None:
        rows = {"--out": out, "--chunk": chunk}
        refuse_others("one state", rows, dict.fromkeys(rows, "with --states"))
    else:
        refuse_others("--states", single, dict.fromkeys(single, "for one state"))
    if states is not None:
        require("--states", "sim")
        from guidance.cli.solve_file import solve_file  # noqa: PLC0415 - pyarrow is heavy, and one state needs none

        solve_file(game, states, out, rows=chunk or 65536, ratio_given=speed_ratio is not None)
        return
    if pursuer is None or evader is None:
        raise ConfigError("--pursuer, --evader: both must be given, or --states")
    given = [_numbers("--pursuer", pursuer, 3), (*_numbers("--evader", evader, 2), 0.0)]
    if target is not None:
        given.append((*_numbers("--target", target, 2), 0.0))
    solve_state(game, given, as_json=as_json)


def _pair(option: str, text: str) -> tuple[float, float]:
    x, y = _numbers(option, text, 2)
    return x, y


def _numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    """Read numbers separated by commas."""
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
        raise ConfigError(f"{option} = {text!r}: must be {count} finite numbers separated by commas")
    return numbers
