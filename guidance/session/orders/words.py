"""Common parts of orders by the socket and by the bus: words, the default endpoint, time limits and senders' names.

Imports nothing heavy, so that `guidance ctl` starts quickly.
"""

import contextlib
import getpass
from typing import Final

STATUS = "status"

RESET = "reset"

ALIVE = "alive"

WORDS: Final = ("abort", "engage", "hold", "land", "return", "start", RESET, STATUS, ALIVE)
"""All orders and queries of a daemon."""

ENDPOINT: Final = "tcp/127.0.0.1:7448"
"""Default control endpoint of daemons and flights."""

REPLY_TIMEOUT_S: Final = 4.0
"""Time limit for the answer, longer than the mailbox waits for the loop."""

TEAM_ANSWER_LIMIT_S: Final = 2.5
"""Time limit for the answers of a team's vehicles, longer than a mailbox waits for its loop."""

TEAM_TIMEOUT_S: Final = 2 * TEAM_ANSWER_LIMIT_S + 1.0
"""Time limit for an order to a team by the socket: `start` and `engage` ask for the status first."""

LONGEST_NAME: Final = 64
"""Longest name of a sender, in characters; it is recorded."""


def own_name(program: str) -> str:
    """Return how a program of this user names itself in an order."""
    with contextlib.suppress(KeyError, OSError):  # a user without a name
        return f"{program}, {getpass.getuser()}"
    return program


def name_in(data: bytes) -> str:
    """Return the sender's name as printable text of bounded length; the data may be anything."""
    text = data[: 4 * LONGEST_NAME].decode("utf-8", errors="replace")
    return "".join(character for character in text if character.isprintable())[
        :LONGEST_NAME
    ].strip()
