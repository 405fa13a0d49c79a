"""A flight that people look at and order while it lasts: a control bus of its own, and its broadcast on it."""

import contextlib
import socket
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from guidance.log.broadcast import Broadcast
from guidance.session.control_bus import ControlBus
from guidance.session.orders import Mailbox


class Onlookers(NamedTuple):
    """Where their orders come in, and what they hear a flight by; None where nobody can be there."""

    mailbox: Mailbox
    broadcast: Broadcast | None = None


@contextlib.contextmanager
def admitted(name: str, metadata: Mapping[str, str], endpoint: str | None) -> Iterator[Onlookers]:
    """Let onlookers in at an endpoint, whoever can read its token; nobody where there is no endpoint.

    Raises:
        OutputError: If the token cannot be written.
        LinkError: If the endpoint cannot be had.
    """
    mailbox = Mailbox()
    if endpoint is None:
        yield Onlookers(mailbox)
        return
    with (
        contextlib.closing(ControlBus(name, mailbox, endpoint=endpoint, host=True)) as control,
        contextlib.closing(Broadcast(name, control.session, metadata)) as broadcast,
    ):
        yield Onlookers(mailbox, broadcast)


def free_endpoint() -> str:
    """Return a control endpoint on a port of loopback that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"
