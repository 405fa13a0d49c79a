"""An order to a daemon on this computer without the command line's libraries: they take longer than the order."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from guidance.errors import FlightError
from guidance.session.control_socket import ENDPOINT, ask_here, own_name

_ORDERS: Final = frozenset({"start", "engage", "hold", "return", "land", "abort", "reset"})
_OPTIONS: Final = frozenset({"--endpoint", "--token-file", "--name"})


def short_order(arguments: Sequence[str]) -> int | None:
    """Give `guidance ctl ORDER` by the socket on this computer; return the exit code.

    Args:
        arguments: Of the command line.

    Returns:
        0 if the order was accepted, 4 if it was refused. None, and nothing is done, for every other command line and
        where no daemon has such a socket.

    Raises:
        GuidanceError: As `ask_here`.
    """
    if arguments[:1] != ["ctl"] or len(arguments) % 2 or arguments[1] not in _ORDERS:
        return None
    options = dict(zip(arguments[2::2], arguments[3::2], strict=True))
    if not options.keys() <= _OPTIONS:
        return None
    token = options.get("--token-file")
    answer = ask_here(
        arguments[1],
        endpoint=options.get("--endpoint", ENDPOINT),
        name=options.get("--name"),
        token_file=None if token is None else Path(token),
        by=own_name("ctl"),
    )
    return None if answer is None else show(answer)


def show(answer: Mapping[str, Any]) -> int:
    """Say in a line what became of an order, in red where it was refused; return the exit code."""
    words = answer_words(answer)
    if answer["accepted"]:
        print(words)  # noqa: T201 - the command's answer
        return 0
    print(f"\033[1;31m{words}\033[0m" if sys.stdout.isatty() else words)  # noqa: T201
    return FlightError.exit_code


def answer_words(answer: Mapping[str, Any]) -> str:
    """Say in a line what became of an order."""
    name, state = answer.get("name", "the daemon"), answer.get("state", "")
    if answer["accepted"]:
        return f"{name}: {answer['order']} accepted, {state}"
    return f"{name}: {answer['order']} refused, {state}: {answer.get('reason', '')}"
