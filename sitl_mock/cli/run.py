"""`sitl-mock run`: a fleet in real time until it is stopped."""

from pathlib import Path
from typing import Annotated

import typer

from sitl_mock.errors import ConfigError


def run(
    vehicles: Annotated[
        list[str] | None,
        typer.Option(
            help="A number (of --flavour), flavours such as `px4@1.17,px4@1.18`, or "
            "`flavour:name[@north,east,down]`, repeated for each vehicle."
        ),
    ] = None,
    flavour: Annotated[
        str,
        typer.Option(
            help="px4, arducopter or rover, with a version as px4@1.18, if --vehicles is a number."
        ),
    ] = "px4",
    fleet: Annotated[
        Path | None, typer.Option(help="TOML file with the vehicles, instead of --vehicles.")
    ] = None,
    faults: Annotated[Path | None, typer.Option(help="TOML file with faults.")] = None,
    zenoh: Annotated[
        str | None,
        typer.Option(
            help="Zenoh endpoint to listen on: tcp/127.0.0.1:7447; port 0 takes a free one."
        ),
    ] = None,
    zenoh_connect: Annotated[
        str | None, typer.Option(help="Zenoh router to connect to instead of listening.")
    ] = None,
    px4_zenoh: Annotated[
        str | None,
        typer.Option(
            help="Zenoh router for PX4's own topics, as of its module zenoh: tcp/127.0.0.1:7447. It may start later."
        ),
    ] = None,
    zenoh_keys: Annotated[
        Path | None,
        typer.Option(help="With --zenoh-connect: credentials, a file of `guidance zenoh keys`."),
    ] = None,
    udp: Annotated[
        int | None,
        typer.Option(
            help="First port of the onboard links; vehicle i sends to PORT + i (ArduPilot: + 10 i).",
            min=1,
            max=65000,
        ),
    ] = None,
    gcs: Annotated[
        int | None,
        typer.Option(help="Port of a ground station; every vehicle sends to it.", min=1, max=65535),
    ] = None,
    ready_after_s: Annotated[
        float | None,
        typer.Option(
            help="Time from boot until arming is possible; default: as measured.", min=0.0
        ),
    ] = None,
    noise: Annotated[
        bool | None,
        typer.Option(
            "--noise/--no-noise",
            help="Estimation error as measured on the real autopilots (default: on).",
        ),
    ] = None,
    param: Annotated[
        list[str] | None,
        typer.Option(
            help="A parameter: `NAME=VALUE`, or `vehicle:NAME=VALUE` for one vehicle; repeatable."
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of all randomness (default: 0).", min=0)
    ] = None,
    speed: Annotated[
        float,
        typer.Option(help="Seconds of the vehicles per real second.", min=0.1, max=100.0),
    ] = 1.0,
    lockstep: Annotated[
        bool,
        typer.Option(
            "--lockstep", help="Time advances only when a client asks for it over MAVLink."
        ),
    ] = False,
    logs: Annotated[
        Path | None,
        typer.Option(help="Folder for the flight logs, which are otherwise in memory only."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print `ready` as one line of JSON.")
    ] = False,
    parent_pipe: Annotated[
        bool,
        typer.Option(
            "--parent-pipe", help="Stop when standard input closes, so that an orphaned child ends."
        ),
    ] = False,
) -> None:
    """Run a fleet in real time, over Zenoh and UDP, until SIGTERM or Ctrl-C.

    `sitl-mock run --vehicles px4:uav1 --vehicles rover:evader@30,0,0 --zenoh tcp/127.0.0.1:7447`

    `sitl-mock run --vehicles 20 --flavour px4 --udp 14540`

    `sitl-mock run --vehicles px4@1.17,px4@1.18,arducopter@4.5,arducopter@4.7 --udp 14540`

    `sitl-mock run --fleet fleet.toml --gcs 14550 --param COM_OF_LOSS_T=0.5 --param uav1:MPC_XY_VEL_MAX=8`

    `sitl-mock run --fleet fleet.toml --zenoh tcp/127.0.0.1:0 --json --parent-pipe`

    `sitl-mock run --vehicles px4:uav1 --zenoh-connect tls/192.168.1.10:7447 --zenoh-keys keys/uav1.toml`

    It prints the addresses for MAVSDK, pymavlink and MAVProxy. Then it shows each vehicle's state, as a table on a
    terminal, otherwise as a line per change.

    `sitl-mock run --vehicles px4 --px4-zenoh tcp/127.0.0.1:7447`

    `sitl-mock run --vehicles px4:uav1 --udp 14540 --speed 5`

    `sitl-mock run --vehicles px4:uav1 --udp 14540 --lockstep`

    `sitl-mock run --vehicles px4:uav1 --udp 14540 --logs flights`

    Over Zenoh a client opens a session with `namespace: "uav1"` and uses the keys `mavlink_raw/in` (towards the
    vehicle) and `mavlink_raw/out`, one packet per sample. A query to `faults` lists, adds and clears faults
    (`faults?do=inject;kind=loss;probability=0.3`; `sitl-mock list faults` names them).
    """
    from sitl_mock.faults import FaultScript, read_script  # noqa: PLC0415 - not needed for `--help`
    from sitl_mock.serving.fleet import (  # noqa: PLC0415 - as above
        checked_fleet,
        parse_vehicles,
        read_fleet,
        with_parameters,
        with_settings,
    )
    from sitl_mock.serving.serve import Pace, Wires, serve  # noqa: PLC0415 - as above

    if lockstep and speed != 1.0:
        raise ConfigError(f"--lockstep and --speed {speed:g}: give one of them")

    options = {"ready_after_s": ready_after_s, "noise": noise}
    settings = {key: value for key, value in options.items() if value is not None}
    specs = [] if vehicles is None else vehicles
    changes = param if param is not None else []
    if fleet is None:
        one_or_more = specs if specs else ["1"]
        config = checked_fleet({"vehicle": parse_vehicles(one_or_more, flavour)}, "--vehicles")
    elif specs:
        raise ConfigError(f"--fleet {fleet} and --vehicles {specs[0]}: give one of them")
    else:
        config = read_fleet(fleet)
    config = with_parameters(with_settings(config, settings, seed), changes)
    script = FaultScript() if faults is None else read_script(faults)
    serve(
        config,
        Wires(zenoh, zenoh_connect, zenoh_keys, udp, gcs, px4_zenoh),
        script,
        as_json=as_json,
        parent_pipe=parent_pipe,
        pace=Pace(speed, lockstep),
        logs=logs,
    )
