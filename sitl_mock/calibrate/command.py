"""What `sitl-mock calibrate` does, from a file's path to the exit code."""

import json
from pathlib import Path

import typer
from rich.console import Console

from sitl_mock.calibrate.comparison import compare
from sitl_mock.calibrate.flight import Flavour, fly_log, guess, replay, vehicle_of
from sitl_mock.calibrate.report import as_plain, table_of, verdict_of
from sitl_mock.calibrate.step_log import read_step_log
from sitl_mock.errors import ConfigError


def calibrate_file(
    file: Path, flavour: str | None, plot: Path | None, *, as_json: bool, dynamics_only: bool = False
) -> int:
    """Compare a file with the mock, print the result, and give the exit code: 0 within the limit, 1 above it.

    The mock is a whole vehicle flown by MAVLink bytes, or (`dynamics_only`) its dynamics alone.

    Raises:
        ConfigError: The file is not a log, the flavour does not exist, or the plot cannot be written.
    """
    log = read_step_log(file)
    chosen, guessed_by = guess(file, log) if flavour is None else (_flavour(flavour), "")
    answers = replay(log, vehicle_of(chosen)) if dynamics_only else fly_log(log, chosen)
    comparison = compare(log, chosen, answers, guessed_by)
    if plot is not None:
        from sitl_mock.calibrate.picture import draw  # noqa: PLC0415 - matplotlib takes a second, and few want a plot

        draw(plot, log, comparison)
    if as_json:
        typer.echo(json.dumps(as_plain(comparison), indent=1))
    else:
        console = Console()
        console.print(table_of(comparison))
        console.print(verdict_of(comparison), soft_wrap=True)
    return 0 if comparison.passed else 1


def _flavour(name: str) -> Flavour:
    try:
        return Flavour(name)
    except ValueError as error:
        msg = f"--flavour is {name!r}; it has to be one of {', '.join(Flavour)}"
        raise ConfigError(msg) from error
