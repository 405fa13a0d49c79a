"""`sitl-mock calibrate` and `sitl-mock compare`: compare the mock with logs of real autopilots."""

from pathlib import Path
from typing import Annotated

import typer

from sitl_mock.errors import imported_for


def calibrate(
    file: Annotated[
        Path,
        typer.Argument(
            help="CSV with `t_s`, `cmd_{n,e,d}_m_s`, `vel_{n,e,d}_m_s`, `pos_{n,e,d}_m`."
        ),
    ],
    flavour: Annotated[
        str | None,
        typer.Option(
            help="px4 or arducopter; guessed from the file's name, else by the better fit."
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a plot here (png, svg, pdf).")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
    dynamics_only: Annotated[
        bool,
        typer.Option(
            "--dynamics-only",
            help="Use the dynamics alone instead of a whole vehicle over MAVLink (faster).",
        ),
    ] = False,
) -> None:
    """Replay a log's velocity commands on the stepped mock and compare the responses.

    Prints rise time, overshoot, steady error and RMS difference for every segment and axis, each as real / mock. Exit
    code 1: the velocity of an axis differs by more than 0.15 m/s RMS over the file; 2: the file is not such a log.
    """
    with imported_for("calibrate"):
        from sitl_mock.calibrate.command import calibrate_file  # noqa: PLC0415 - numpy and rich are not for `--help`

    raise typer.Exit(
        calibrate_file(file, flavour, plot, as_json=as_json, dynamics_only=dynamics_only)
    )


def compare(
    file: Annotated[
        Path,
        typer.Argument(
            help="A .tlog of PX4, ArduCopter or Rover, including the client's messages."
        ),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
    ranges: Annotated[
        bool, typer.Option(help="Also print the range of every field on both sides.")
    ] = False,
) -> None:
    """Replay a recorded client on the mock and compare the mock's messages with the recorded ones.

    `sitl-mock compare flight.tlog` prints the rate of each message on both sides and every difference: missing or extra
    messages, rates more than 20 % apart, and fields that are constant or NaN on one side only, on the ground and in the
    air.

    Bytes that are no frames are skipped, a step of the recording clock is replaced by the vehicle's own clock, and a
    log without HOME_POSITION is flown where the vehicle was. Notes above the tables (`notes` in JSON) say so, and also
    that a log has only the vehicle's side.

    Exit code 0: no difference; 1: differences; 2: the file is not such a log.
    """
    from sitl_mock.compare.command import compare_file  # noqa: PLC0415 - not needed for `--help`

    raise typer.Exit(compare_file(file, as_json=as_json, ranges=ranges))
