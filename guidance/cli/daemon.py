"""`guidance run` and `ctl`: the daemon of a vehicle, and the orders for it."""

import contextlib
import json
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from guidance.cli import INTERRUPTED, ask_daemon, print_answer
from guidance.cli.arguments import AsJson, Panel, TokenFile, ZenohFile, completed
from guidance.cli.carrying_out import AIMS, carried_out
from guidance.cli.viewers import panel_beside
from guidance.config import find
from guidance.errors import ConfigError, FlightError
from guidance.extras import require_extras
from guidance.screen import Cell, console, pairs
from guidance.session.orders.words import ENDPOINT, STATUS, WORDS


def run(
    config: Annotated[
        str, typer.Argument(help="A vehicle file, or one of the package: px4, arducopter.")
    ],
    panel: Panel = False,
) -> None:
    """Run the offboard guidance daemon of one vehicle, on its companion computer.

    Connects to the autopilot and to the source of the evader's reports, checks both, and waits for orders
    (`guidance ctl`, `guidance panel`): nothing arms and nothing engages by itself. SIGTERM and Ctrl-C hand the vehicle
    to the autopilot and end; the last line says whether it is still armed. SIGHUP reads the file again, on the ground.

    - `guidance run vehicle.toml`: it waits, and says for what
    - `guidance run config/vehicles/px4.toml --panel`: with the operator's page beside it
    """
    from guidance.session.service import run_vehicle  # noqa: PLC0415 - zenoh and mavsdk take a second
    from guidance.session.vehicle_file import load_vehicle  # noqa: PLC0415

    path = find(config, "vehicles")
    vehicle_config = load_vehicle(path)
    with contextlib.ExitStack() as closing:
        if panel:
            require_extras("--panel", "panel")
            endpoint = vehicle_config.control.endpoint
            if vehicle_config.control.by_tls:
                refused = f"--panel with control.endpoint = {endpoint!r}: that router judges who may order"
                remedy = f"leave it out, and run guidance panel --endpoint {endpoint} --zenoh FILE (an operator's)"
                raise ConfigError(f"{refused}; {remedy}")
            served_panel = panel_beside(
                endpoint, vehicle_config.record.folder, vehicle_config.control.token_file
            )
            closing.callback(served_panel.close)
        interrupted = run_vehicle(path, vehicle_config)
    if interrupted:
        raise typer.Exit(INTERRUPTED)


def ctl(
    order: Annotated[
        str,
        typer.Argument(
            help="start, engage, hold, land, return, abort, reset, status or alive.",
            autocompletion=completed(*WORDS),
        ),
    ],
    name: Annotated[
        str | None, typer.Option(help="Of one of several vehicles; with --team uav1,uav2.")
    ] = None,
    team: Annotated[
        str | None, typer.Option(help="To all vehicles of a team, or to those of --name.")
    ] = None,
    wait: Annotated[
        bool, typer.Option("--wait", help="Wait until the order is carried out, or cannot be.")
    ] = False,
    endpoint: Annotated[str, typer.Option(help="The daemon's control endpoint.")] = ENDPOINT,
    token_file: TokenFile = None,
    zenoh: ZenohFile = None,
    as_json: AsJson = False,
) -> None:
    """Give a running daemon an order, and say what became of it; `status` shows where the flight stands.

    - `start`: THE VEHICLE IS ARMED, takes off, flies to the start and stands by
    - `engage`: plays the game, after standing by or a hold
    - `hold`, `return`, `land`: hands the vehicle to the autopilot's mode of that name, until the next order
    - `abort`: lands at once; on the ground it ends the flight, and `reset` begins another
    - `alive`: a sign of life, where `flight.operator_timeout_s` asks for one; every other order is one too
    - `reset`: after a flight is over, on the ground: ready for another one

    The daemon lets in who can read its token file: its own user, unless the file's rights say more. From another
    computer orders go by a router, which judges certificates (`docs/zenoh.md`).

    With `--wait`, `start` ends when the vehicle stands by, `engage` when the stand-off disc is reached, `hold`,
    `return`, `land` and `abort` when the autopilot has done so. Another end of it, or another order, is code 4.

    Exit codes: 0 accepted, 4 refused (the answer says why), 3 no answer.

    - `guidance ctl engage --name px4`: to one of several daemons
    - `watch guidance ctl alive`: a person is there, until Ctrl-C
    - `guidance ctl status --json`: for programs
    - `guidance ctl hold --team north`: to all vehicles of a team
    - `guidance ctl start --wait && guidance ctl engage --wait && guidance ctl land --wait`: a whole flight
    - `guidance ctl hold --endpoint tls/192.168.1.10:7447 --zenoh keys/operator.toml`: by a router
    """
    if wait and order not in AIMS:
        allowed = ", ".join(AIMS)
        raise ConfigError(f"--wait: only with {allowed}, not with {order}; remove it")
    by: dict[str, Any] = {"endpoint": endpoint, "token_file": token_file, "zenoh": zenoh}
    answers = ask_daemon(order, name=name, team=team, **by)
    if wait and all(answer["accepted"] for answer in answers):
        if team is None and name is None:
            name = str(answers[0]["name"])
        answers = carried_out(order, lambda: ask_daemon(STATUS, name=name, team=team, **by))
    if as_json:
        document = answers[0] if team is None else answers
        typer.echo(json.dumps(document, indent=2))
    else:
        for answer in answers:
            if answer["order"] == STATUS and answer["accepted"]:
                console().print(status_table(answer))
            else:
                print_answer(answer)
    if not all(answer["accepted"] for answer in answers):
        raise typer.Exit(FlightError.exit_code)


Status = Mapping[str, Any]


def status_table(status: Status) -> RenderableType:
    """Lay out a daemon's status: state, telemetry, game and failed checks."""
    to_do = []
    for row in status.get("to_do", ()):
        verdict = row["verdict"]
        style = "bold red" if verdict == "refuse" else "yellow"
        line = f"{verdict:6}  {row['name']} is {row['found']}"
        if row["wanted"]:
            line += f", wanted {row['wanted']}"
        if row["advice"]:
            line += f": {row['advice']}"
        to_do.append(Text(line, style))
    return Group(pairs(_rows(status)), *to_do)


def _rows(status: Status) -> Iterator[tuple[str, Cell]]:
    yield "vehicle", str(status.get("name", "-"))
    state = str(status.get("state", "-"))
    yield "state", Text(state, "bold")
    if "waiting_for" in status:
        waited = f"{_value_words(status, 'waited_s', '{:.0f}')} s so far"
        limit = f"{_value_words(status, 'connect_timeout_s', '{:.0f}')} s at most"
        yield "waiting", f"for {status['waiting_for']}, {waited}, {limit}"
        return
    if status.get("next"):
        yield "next", Text(str(status["next"]), "yellow")
    armed = "armed" if status.get("armed") else "disarmed"
    streaming = "setpoints are sent" if status.get("streaming") else "no setpoints are sent"
    mode = status.get("autopilot_mode", status.get("mode"))
    yield "autopilot", f"{mode}, {armed}, {streaming}"
    beat = _value_words(status, "heartbeat_age_s", "{:.1f} s ago", "never")
    position = _value_words(status, "position_age_s", "{:.1f} s ago", "never")
    yield "heard", f"HEARTBEAT {beat}, position {position}"
    if status.get("height_m") is not None:
        yield "height", f"{status['height_m']:z.1f} m above home"
        north_m, east_m, _ = map(_number, status["position_ned_m"])
        yield "position", f"{north_m:z.1f} m north, {east_m:z.1f} m east of the origin"
        north_m_s, east_m_s, down_m_s = map(_number, status["velocity_ned_m_s"])
        level_m_s = math.hypot(north_m_s, east_m_s)
        yield "speed", f"{level_m_s:.1f} m/s level, {-down_m_s:z.1f} m/s up"
        yield "battery", _value_words(status, "battery", "{:.0%}", "not told")
    silence = _value_words(status, "evader_silence_s", "{:.1f} s ago", "never")
    yield "evader", f"heard {silence}"
    game = status.get("certificate")
    if game:
        yield from _game_rows(status, game)
    yield "record", str(status.get("recording", "-"))


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _game_rows(status: Status, game: Status) -> Iterator[tuple[str, Cell]]:
    range_m = _value_words(status, "range_m")
    gap_m = _value_words(game, "gap_m")
    yield "range", f"{range_m} m to the evader, {gap_m} m to the stand-off disc's rim"
    unit = status["value_unit"]
    quantity = "value to go" if unit == "s" else "evader's distance from its target"
    value = _value_words(game, "value")
    yield "ideal game", f"winner {game['winner']}; {quantity} {value} {unit}"
    needs_s = _value_words(game, "time_needed_s")
    reaches_m_s = _value_words(game, "reachable_speed_m_s")
    winner = game.get("vehicle_winner", "undecided")
    yield "this vehicle", f"winner {winner}; needs {needs_s} s, reaches {reaches_m_s} m/s"
    if game.get("active_limits"):
        yield "limited by", ", ".join(game["active_limits"])


def _value_words(values: Status, key: str, form: str = "{:.1f}", unknown: str = "-") -> str:
    value = values.get(key)
    return unknown if value is None else form.format(value)
