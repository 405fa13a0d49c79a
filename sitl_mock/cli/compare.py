"""`sitl-mock calibrate` and `sitl-mock compare`: the mock beside logs of real autopilots."""

from pathlib import Path
from typing import Annotated

import typer


def calibrate(
    file: Annotated[
        Path, typer.Argument(help="CSV with `t_s`, `cmd_{n,e,d}_m_s`, `vel_{n,e,d}_m_s`, `pos_{n,e,d}_m`.")
    ],
    flavour: Annotated[
        str | None, typer.Option(help="px4 or arducopter; guessed from the file's name, else by the better fit.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a plot here (png, svg, pdf).")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
    dynamics_only: Annotated[
        bool,
        typer.Option(
            "--dynamics-only", help="Step the dynamics alone instead of flying a whole vehicle by MAVLink: faster."
        ),
    ] = False,
) -> None:
    """Replay a log's velocity commands through the stepped mock and compare.

    Prints rise time, overshoot, steady error and RMS difference for every segment and axis, each as real / mock.
    Ends with 1 when the velocity of any axis differs by more than 0.15 m/s RMS over the file, with 2 when the file is
    not such a log.
    """
    from sitl_mock.calibrate.command import calibrate_file  # noqa: PLC0415 - numpy and rich are not for `--help`

    raise typer.Exit(calibrate_file(file, flavour, plot, as_json=as_json, dynamics_only=dynamics_only))


def compare(
    file: Annotated[Path, typer.Argument(help="A .tlog of PX4, ArduCopter or Rover, with what the client sent.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
    ranges: Annotated[bool, typer.Option(help="Also the range of every field on both sides.")] = False,
) -> None:
    """Fly a recorded client against the mock and lay its messages beside the recorded ones.

    `sitl-mock compare flight.tlog` prints how often each message came on both sides, and every difference: messages
    that are missing or extra, rates more than 20 % apart, fields that stand still or are NaN on one side only, on the
    ground and in the air.

    Ends with 0 when there is no difference, with 1 when there is one, with 2 when the file is no such log.
    """
    from sitl_mock.compare.command import compare_file  # noqa: PLC0415 - nothing of it is needed for `--help`

    raise typer.Exit(compare_file(file, as_json=as_json, ranges=ranges))
