"""Implementation of `sitl-mock calibrate`: from a file's path to the exit code."""

import json
import math
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.table import Table

from sitl_mock.calibrate.comparison import RMS_LIMIT_M_S, Comparison, compare_log
from sitl_mock.calibrate.flight import fly_log, guess, replay, vehicle_of
from sitl_mock.calibrate.step_log import FlavourName, read_step_log
from sitl_mock.errors import ConfigError, imported_for


def comparison_table(comparison: Comparison) -> Table:
    """Return a table with one row per segment and axis; cells with two numbers are real / mock."""
    guess_words = f", guessed by {comparison.guessed_by}" if comparison.guessed_by else ""
    table = Table(
        title=f"{comparison.flavour.value}{guess_words}: real / mock",
        caption="m/s, s; -: not measurable",
    )
    for name in (
        "from",
        "axis",
        "command",
        "rise 10-90 %",
        "overshoot",
        "steady error",
        "RMS difference",
    ):
        table.add_column(name, justify="right")
    for segment in comparison.segments:
        for axis in segment.axes:
            table.add_row(
                f"{segment.start_s:.1f}" if axis.axis == "N" else "",
                axis.axis,
                "varying" if segment.varying else f"{axis.command_m_s:g}",
                _pair(axis.real.rise_s, axis.mock.rise_s),
                _pair(axis.real.overshoot_m_s, axis.mock.overshoot_m_s),
                _pair(axis.real.steady_error_m_s, axis.mock.steady_error_m_s),
                f"{axis.rms_m_s:.3f}",
                end_section=axis.axis == "D",
            )
    return table


def verdict_of(comparison: Comparison) -> str:
    """Return the overall numbers as a line."""
    n, e, d = comparison.rms_ned_m_s
    word = "within" if comparison.passed else "ABOVE"
    measured = f"Overall velocity RMS: N {n:.3f}, E {e:.3f}, D {d:.3f} m/s"
    return f"{measured}, {word} the limit of {RMS_LIMIT_M_S} m/s per axis."


def as_plain(comparison: Comparison) -> dict[str, Any]:
    """Return the comparison for JSON: NaN becomes null."""
    return {
        "flavour": comparison.flavour.value,
        "passed": comparison.passed,
        "rms_ned_m_s": list(comparison.rms_ned_m_s),
        "segments": [
            {
                "start_s": segment.start_s,
                "end_s": segment.end_s,
                "varying": segment.varying,
                "axes": {
                    axis.axis: {
                        "command_m_s": _null(axis.command_m_s),
                        "rms_m_s": axis.rms_m_s,
                        "real": {name: _null(value) for name, value in axis.real._asdict().items()},
                        "mock": {name: _null(value) for name, value in axis.mock._asdict().items()},
                    }
                    for axis in segment.axes
                },
            }
            for segment in comparison.segments
        ],
    }


def _null(value: float) -> float | None:
    return None if math.isnan(value) else value


def _pair(real: float, mock: float) -> str:
    return f"{_cell(real)} / {_cell(mock)}" if not (math.isnan(real) and math.isnan(mock)) else "-"


def _cell(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.2f}"


def calibrate_file(
    file: Path,
    flavour: str | None,
    plot: Path | None,
    *,
    as_json: bool,
    dynamics_only: bool = False,
) -> int:
    """Compare a file with the mock, print the result, return the exit code: 0 within the limit, 1 above it.

    Args:
        file: CSV, as `read_step_log` reads it.
        flavour: Flavour of the mock; None guesses from the file.
        plot: File of a picture, None for none.
        as_json: Print JSON.
        dynamics_only: Use the dynamics alone instead of a whole vehicle flown over MAVLink.

    Raises:
        ConfigError: The file is not a log, the flavour does not exist, or the plot cannot be written.
    """
    log = read_step_log(file)
    if flavour is None:
        chosen, guessed_by = guess(file, log)
    else:
        try:
            chosen = FlavourName(flavour)
        except ValueError as error:
            msg = f"--flavour {flavour}: allowed are {', '.join(FlavourName)}"
            raise ConfigError(msg) from error
        guessed_by = ""
    answers = replay(log, vehicle_of(chosen)) if dynamics_only else fly_log(log, chosen)
    comparison = compare_log(log, chosen, answers, guessed_by)
    if plot is not None:
        with imported_for(f"--plot {plot}"):
            from sitl_mock.calibrate.picture import draw  # noqa: PLC0415 - matplotlib takes a second

        draw(plot, log, comparison)
    if as_json:
        typer.echo(json.dumps(as_plain(comparison), indent=1))
    else:
        console = Console()
        console.print(comparison_table(comparison))
        console.print(verdict_of(comparison), soft_wrap=True)
    return 0 if comparison.passed else 1
