"""A control bus that a test opens and closes, and orders over it."""

import contextlib

from guidance.links.zenoh.credentials import NO_CREDENTIALS
from guidance.links.zenoh.session import direct_session
from guidance.session.orders import control_bus, control_client
from guidance.session.orders.control_token import draw_token
from guidance.session.orders.words import REPLY_TIMEOUT_S


class ControlBus:
    """Takes orders until it is closed; arguments as of `control_bus`."""

    def __init__(self, name, mailbox, control, credentials=NO_CREDENTIALS, team="", mates=()):
        self._open = contextlib.ExitStack()
        self.mailbox = mailbox
        bus = control_bus.control_bus(name, mailbox, control, credentials, team, mates)
        self.session = self._open.enter_context(bus)

    def close(self):
        self._open.close()


def ask(order, *, endpoint, name, timeout_s=REPLY_TIMEOUT_S, **joining):
    """Give an order on a session of its own; more arguments as of `join_session`."""
    with control_client.join_session(endpoint, **joining) as session:
        return control_client.ask(session, order, name, endpoint=endpoint, timeout_s=timeout_s)


def open_to_all(endpoint):
    """Host a session at an endpoint that every user of this computer may join."""
    return direct_session("router", {"listen": {"endpoints": [endpoint]}})


def published(path):
    """Return a new token in its place, as a daemon puts it there when it listens."""
    drawn = draw_token(path)
    return drawn._replace(path=drawn.path.replace(path))
