"""The `guidance` command. Orders take a fast path; all other commands are in `guidance.cli.program`."""

import gc
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from guidance.cli.streams import open_outlets
from guidance.errors import FlightError, GuidanceError, OutputError
from guidance.texts import printable

INTERRUPTED = 130
FAULT = 70
"""Exit code of an internal error (EX_SOFTWARE of sysexits.h)."""

_COLLECTED_AFTER: Final = 20_000
"""Objects after which garbage is searched for; what modules create stays, and searching is an eighth of a start."""

_ORDERS: Final = frozenset({"start", "engage", "hold", "return", "land", "abort", "reset"})
_OPTIONS: Final = {
    "--endpoint": str,
    "--name": str,
    "--team": str,
    "--token-file": Path,
    "--zenoh": Path,
}


def main() -> None:
    """Run the command line. Errors that the user can fix end with a message and an exit code (`docs/exit-codes.md`)."""
    open_outlets()
    gc.set_threshold(_COLLECTED_AFTER)
    try:
        _run()
    except KeyboardInterrupt:
        _end("interrupted before anything began", INTERRUPTED)
    except GuidanceError as error:
        _end(str(error), error.exit_code)
    except OSError as error:
        file = f"{error.filename}: " if error.filename is not None else ""
        _end(f"{file}{error.strerror or error}", OutputError.exit_code)
    except Exception:
        import traceback  # noqa: PLC0415 - slow import

        traceback.print_exc()
        _end("internal error of guidance: please report it with the lines above", FAULT)


def _run() -> None:
    try:
        code = _short_order(sys.argv[1:])
        if code is None:
            from guidance.cli.program import app  # noqa: PLC0415 - typer takes a third of a second

            app()
        sys.exit(code)
    finally:
        sys.stdout.flush()


def _short_order(arguments: Sequence[str]) -> int | None:
    """Give `guidance ctl ORDER` and return the exit code; None, and nothing is done, for every other command line.

    It needs none of the command line's libraries, whose import takes longer than the order.
    """
    if arguments[:1] != ["ctl"] or len(arguments) % 2 or arguments[1] not in _ORDERS:
        return None
    option_words = dict(zip(arguments[2::2], arguments[3::2], strict=True))
    if not option_words.keys() <= _OPTIONS.keys():
        return None
    options: dict[str, Any] = {
        name[2:].replace("-", "_"): _OPTIONS[name](word) for name, word in option_words.items()
    }
    return max(map(print_answer, ask_daemon(arguments[1], **options)))


def ask_daemon(
    order: str,
    *,
    endpoint: str | None = None,
    name: str | None = None,
    team: str | None = None,
    token_file: Path | None = None,
    zenoh: Path | None = None,
) -> Sequence[Mapping[str, Any]]:
    """Give an order to a daemon, by its socket if it has one on this computer, else over Zenoh; or to a team.

    Args:
        order: An order or a query of a daemon.
        endpoint: The daemon's control endpoint; None is the usual one.
        name: The daemon's; None takes the only one there is. Of a team: names separated by commas; None is all.
        team: Name of the team.
        token_file: Where its token lies, if not in the usual place.
        zenoh: Our settings for a router that judges certificates, in place of a token.

    Returns:
        An answer of each vehicle.

    Raises:
        ConfigError: If there is no such order, several daemons and no name, or the token may not be read.
        LinkError: If the daemon has another name, does not know the token or does not answer.
    """
    from guidance.session.orders import socket_client, words  # noqa: PLC0415 - only orders

    names: list[str] = []
    if name is not None:
        names = name.split(",")
    if not endpoint:
        endpoint = words.ENDPOINT
    details: dict[str, Any] = {"endpoint": endpoint, "token_file": token_file}
    by = words.own_name("ctl")
    if zenoh is None and team is not None:
        try:
            answers = socket_client.ask_team_here(order, team, names, by=by, **details)
        except socket_client.SilentDaemonError as error:
            # A daemon that hangs keeps no order from the others: they are reached over Zenoh then.
            print(f"{error}; trying over Zenoh", file=sys.stderr)  # noqa: T201
            answers = None
        if answers is not None:
            return answers
    elif zenoh is None:
        answer = socket_client.ask_here(order, name=name, by=by, **details)
        if answer is not None:
            return [answer]
    from guidance.links.zenoh import credentials as zenoh_credentials  # noqa: PLC0415 - only orders over Zenoh
    from guidance.session.orders import control_client  # noqa: PLC0415 - only orders by a router

    if zenoh is None:
        details["credentials"] = zenoh_credentials.NO_CREDENTIALS
    else:
        # What is rare or wrong in the settings is left to the full check.
        details["credentials"] = zenoh_credentials.certificate_credentials(zenoh)
        if details["credentials"] is None:
            from guidance.links.zenoh.access import read_credentials  # noqa: PLC0415 - pydantic is slow to import

            details["credentials"] = read_credentials(zenoh)
    with control_client.join_session(**details) as session:
        if team is None:
            return [control_client.ask(session, order, name, endpoint=details["endpoint"], by=by)]
        return control_client.order_team(session, order, team, names, by=by)


def print_answer(answer: Mapping[str, Any]) -> int:
    """Say in a line what became of an order, in red where it was refused; return the exit code."""
    name = answer.get("name", "the daemon")
    state = answer.get("state", "")
    if answer["accepted"]:
        print(f"{name}: {answer['order']} accepted, {state}")  # noqa: T201 - the command's answer
        return 0
    words = f"{name}: {answer['order']} refused, {state}: {answer.get('reason', '')}"
    print(f"\033[1;31m{words}\033[0m" if sys.stdout.isatty() else words)  # noqa: T201
    return FlightError.exit_code


def _end(words: str, code: int) -> None:
    lines = "\n".join(map(printable, words.splitlines()))  # the message may quote an untrusted file
    print(f"error: {lines}", file=sys.stderr)  # noqa: T201
    sys.exit(code)
