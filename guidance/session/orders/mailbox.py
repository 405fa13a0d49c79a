"""Orders and questions on their way to the loop, and answers on their way back.

Two orders take time. An engage order waits until the parameters that act when setpoints stop and the uploaded fence
were read again: preflight read them on the ground, and any ground station may have changed them since. A pilot's switch
to the guided mode waits for the same. A value that does not arrive in time is a refusal. The other is the last order of
a process that ends: it hands the vehicle to the autopilot and waits until HEARTBEAT shows the mode.
"""

import math
import queue
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, Final

from guidance.autopilots import Finding, Mode, Wants
from guidance.clock import Clock
from guidance.flight import BEFORE_FLIGHT, FINAL, Authority, EngageOn, Event, Flight, State
from guidance.flight.table import ASKED_MODES, HANDING_OVER
from guidance.preflight import PreflightMemory, engage_rows, parameter_names, refusals
from guidance.session.orders.replies import Reply
from guidance.session.orders.words import ALIVE, STATUS, WORDS

MOST_ORDERS: Final = 64
MOST_QUERIES: Final = 256
"""Longest queues. The loop empties both every cycle, so only a loop that hangs fills them."""

ANSWER_LIMIT_S: Final = 2.0
QUERIES: Final = frozenset({STATUS, ALIVE})
"""Words that are answered with the status and change nothing."""


HANDOVER_LIMIT_S: Final = 12.0
"""After this the daemon ends anyway: its stream ends, and the autopilot's own failsafe acts."""

ORDER_OF: Final = {"hold": Event.HOLD, "land": Event.LAND, "return": Event.RETURN}
READ_WITHIN_S: Final = 1.5
"""Time for reading parameters again: a link asks three times, and the person still waits for the answer."""

FENCE_WITHIN_S: Final = 10.0
"""An order refused because the fence was still being read can be repeated within this time."""


class Question(Future[Reply]):
    """One order or query; its result is the answer.

    Args:
        order: One of `WORDS`.
        by: Name of the person or program; empty if unknown.
        authority: Whether a person asks or a mission.
    """

    def __init__(self, order: str, by: str = "", authority: Authority = Authority.OPERATOR) -> None:
        super().__init__()
        self.order = order
        self.by = by
        self.authority = authority


class Mailbox:
    """Filled by any thread, emptied by the loop once a cycle. Queries never take an order's place.

    Attributes:
        meanwhile: Answers everything on the asking thread, while no loop runs; None: the loop answers.
        oversized: Number of queries that were dropped unread.
    """

    def __init__(self) -> None:
        self._orders = queue.Queue[Question](MOST_ORDERS)
        self._queries = queue.Queue[Question](MOST_QUERIES)
        self.meanwhile: Callable[[str], Reply] | None = None
        self.oversized = 0

    @property
    def waiting_orders(self) -> int:
        """Number of orders that the loop has not taken yet."""
        return self._orders.qsize()

    def ask(self, order: str, by: str = "", authority: Authority = Authority.OPERATOR) -> Question:
        """Put an order or a query to the loop. It is answered at once if the queue is full or no loop runs yet."""
        question = Question(order, by, authority)
        meanwhile = self.meanwhile
        if meanwhile is not None:
            question.set_result(meanwhile(order))
            return question
        try:
            waiting = self._queries if order in QUERIES else self._orders
            waiting.put_nowait(question)
        except queue.Full:
            reason = "too many wait already; does the loop run?"
            question.set_result({"accepted": False, "order": order, "reason": reason})
        return question

    def answer(self, order: str, by: str) -> Reply:
        """Put an order or a query to the loop, and wait for the answer, `ANSWER_LIMIT_S` at most."""
        try:
            return self.ask(order, by).result(ANSWER_LIMIT_S)
        except TimeoutError:
            reason = f"the loop did not answer within {ANSWER_LIMIT_S:g} s"
            return {"accepted": False, "order": order, "reason": reason}

    def take(self) -> tuple[Sequence[Question], Sequence[Question]]:
        """Take all orders and all queries that wait, each oldest first."""
        orders = [self._orders.get() for _ in range(self._orders.qsize())]
        queries = [self._queries.get() for _ in range(self._queries.qsize())]
        return orders, queries


def startup_answers(
    name: str, waiting_for: str, limit_s: float, clock: Clock
) -> Callable[[str], Reply]:
    """Return what answers every order before the loop runs: the status, or a refusal until the vehicle is there.

    Args:
        name: The vehicle's.
        waiting_for: The awaited event, in words.
        limit_s: Time limit of the wait.
        clock: The process's.
    """
    since_s = clock.now_s()

    def answer_of(order: str) -> Reply:
        waited_s = round(clock.now_s() - since_s, 1)
        answer: dict[str, Any] = {
            "order": order,
            "name": name,
            "state": "waiting",
            "waiting_for": waiting_for,
            "waited_s": waited_s,
            "connect_timeout_s": limit_s,
            "accepted": order == STATUS,
        }
        if order not in WORDS:
            answer["reason"] = f"order = {order!r}: allowed are {', '.join(WORDS)}"
        elif order != STATUS:
            answer["reason"] = f"waiting for {waiting_for}, {waited_s:g} s so far"
        return answer

    return answer_of


class ShutdownHandover:
    """A daemon that ends: the order that it gives then, and whether the vehicle has followed.

    Args:
        order: The order that hands the vehicle over.
        now_s: The present.
        authority: Whether a person or a mission ends it. An operator's order cancels a mission's end.
    """

    def __init__(
        self, order: Event, now_s: float, authority: Authority = Authority.OPERATOR
    ) -> None:
        self.authority = authority
        self._order = order
        self._since_s = now_s
        self._given = False

    def orders(self, flight: Flight) -> tuple[Question, ...]:
        """The order that hands the vehicle over, once."""
        if self._given or flight.state in FINAL | BEFORE_FLIGHT:
            return ()
        self._given = True
        return (Question(str(self._order), authority=self.authority),)

    def finished(self, flight: Flight, now_s: float) -> bool:
        """True once there is nothing more to hand over, or no more time."""
        if flight.state in FINAL | BEFORE_FLIGHT or now_s - self._since_s > HANDOVER_LIMIT_S:
            return True
        is_left = flight.state in HANDING_OVER and flight.mode_name == ASKED_MODES[flight.state]
        return is_left and flight.observed.has_flown  # on the ground it is disarmed first


class Engaging:
    """Engage orders that wait until the failsafe parameters and the uploaded fence were read again.

    Args:
        flight: Of the vehicle.
        survey: Reads its parameters.
        wants: The accepted values; None reads nothing.

    Attributes:
        asked_s: Since when parameters are being read; None if they are not.
        rows: Findings of the last reading.
    """

    def __init__(self, flight: Flight, survey: PreflightMemory, wants: Wants | None) -> None:
        self._flight = flight
        self._survey = survey
        self._wants = wants
        self._fence_since_s = -math.inf
        self._waiting = list[Question]()
        self._for_a_pilot = False
        self.asked_s: float | None = None
        self._to_pilot: tuple[str, ...] | None = None
        self.rows: tuple[Finding, ...] = ()

    def wait(self, question: Question, now_s: float) -> None:
        """Let an order wait until the parameters were read again."""
        self._waiting.append(question)
        self._read(now_s)

    def give_up(self) -> tuple[Question, ...]:
        """Return the orders that wait; they will not be given."""
        waiting = tuple(self._waiting)
        self._waiting = []
        return waiting

    def due(self, now_s: float) -> tuple[Question, ...] | None:
        """Judge the parameters once all were read or the time is up; return the orders due then, None before that."""
        self._for_a_pilot = (
            self._wants is not None
            and self._flight.settings.engage_on is EngageOn.PILOT_MODE
            and self._flight.state is State.STANDING_BY
        )
        piloted = self._for_a_pilot and self._flight.mode_name == Mode.GUIDED
        if not piloted:
            self._to_pilot = None
        elif self._to_pilot is None:
            self._read(now_s)
        if self.asked_s is None:
            return None
        fence_read = self._survey.fence_read_since(self._fence_since_s)
        everything_read = fence_read and self._survey.parameters_complete
        if not everything_read and now_s - self.asked_s < READ_WITHIN_S:
            return None
        self.asked_s = None
        if self._wants is not None:
            self.rows = engage_rows(
                self._survey.facts(self._flight.vehicle, now_s),
                self._flight.settings.autopilot,
                self._wants,
                unread_fence="" if fence_read else self._survey.fence_progress,
            )
        if fence_read:
            self._fence_since_s = -math.inf
        if piloted:
            self._to_pilot = refusals(self.rows)
        return self.give_up()

    @property
    def bars_the_pilot(self) -> tuple[str, ...]:
        """Names of what keeps a pilot's switch to the guided mode from engaging."""
        if not self._for_a_pilot:
            return ()
        if self._to_pilot is None:
            return ("parameters read again",)
        return self._to_pilot

    def _read(self, now_s: float) -> None:
        if self.asked_s is not None:
            return
        self.asked_s = now_s
        announces = self._wants is not None and self._wants.announces
        version = self._survey.version
        self._survey.read_again(parameter_names(version, announces=announces, only_needed=True))
        # If a fence is too large for the last order's time, reading continues and serves the next order.
        if now_s - self._fence_since_s > FENCE_WITHIN_S:
            self._fence_since_s = now_s
            self._survey.read_fence_again()
