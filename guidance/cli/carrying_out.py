"""`guidance ctl ORDER --wait`: follows the status of vehicles until an order is carried out, or cannot be."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

import typer

from guidance.session.orders.replies import Reply, refused

POLL_S: Final = 0.2


class OrderStates(NamedTuple):
    """States of a flight after an accepted order.

    Attributes:
        under_way: It is being carried out.
        done: It is carried out.
    """

    under_way: frozenset[str]
    done: frozenset[str]


def _order_states(under_way: str, done: str) -> OrderStates:
    return OrderStates(frozenset(under_way.split(", ")), frozenset(done.split(", ")))


AIMS: Final[Mapping[str, OrderStates]] = {
    "start": _order_states(
        "arming, climbing, positioning", "standing by, entering, engaged, on station"
    ),
    "engage": _order_states("standing by, entering, engaged, paused", "on station"),
    "hold": _order_states("holding", "holding"),
    "return": _order_states("returning, landing", "landed"),
    "land": _order_states("landing", "landed"),
    "abort": _order_states("landing", "landed, failed"),
}
"""For each order that can be waited for. Any other state ends the wait: the order was not carried out."""

_CAPTURED: Final = ("stand-off reached", "stand-off reached, return configured")
"""Causes of a state that carry out `engage` in every state: what follows is the vehicle file's `after_capture`."""


def carried_out(
    order: str,
    ask_status: Callable[[], Sequence[Reply]],
    sleep: Callable[[float], None] = time.sleep,
) -> Sequence[Reply]:
    """Wait until every vehicle has carried out an order or cannot any more; say each change of state meanwhile.

    Args:
        order: A key of `AIMS`.
        ask_status: Asks for the status of the vehicles.
        sleep: Waits for seconds.

    Returns:
        An answer to the order for each vehicle, with its last state.
    """
    aim = AIMS[order]
    last_states = dict[str, str]()
    while True:
        statuses = ask_status()
        for status in statuses:
            name = str(status["name"])
            state = str(status.get("state", ""))
            if last_states.get(name) != state:
                last_states[name] = state
                typer.echo(f"{name}: {state}", err=True)
        if not any(
            not _is_done(order, status, aim) and status.get("state") in aim.under_way
            for status in statuses
        ):
            answers: list[Reply] = []
            for status in statuses:
                name = str(status["name"])
                state = str(status.get("state", ""))
                if _is_done(order, status, aim):
                    answers.append({"accepted": True, "name": name, "order": order, "state": state})
                else:
                    causes = filter(
                        None, (status.get("reason"), status.get("cause"), "no cause known")
                    )
                    answers.append(
                        refused(
                            name, order, state, f"accepted, and not carried out: {next(causes)}"
                        )
                    )
            return answers
        sleep(POLL_S)


def _is_done(order: str, status: Reply, aim: OrderStates) -> bool:
    if order == "hold" and status.get("mode") != "hold":
        return False
    if order == "engage" and status.get("cause") in _CAPTURED:
        return True
    return status.get("state") in aim.done
