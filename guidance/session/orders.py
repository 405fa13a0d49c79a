"""Orders on their way to the loop, and answers on their way back. Bounded: who asks too much is told so.

The last order is the own of a process that ends: hand the vehicle to the autopilot, see it taken, then go.
"""

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from guidance.autopilots import Mode
from guidance.flight import FINAL, ORDERS, Event, Flight, State

MOST_WAITING: Final = 16

STATUS, RESET, ALIVE = "status", "reset", "alive"
WORDS: Final = (*sorted(str(order) for order in ORDERS), RESET, STATUS, ALIVE)
"""What may be ordered."""

Answer = Mapping[str, Any]


class Question:
    """One order, until it is answered. `by` says who gave it, empty where nobody said; `told` is called then."""

    def __init__(self, order: str, by: str = "", told: Callable[[], None] = lambda: None) -> None:
        self.order = order
        self.by = by
        self._told = told
        self._answer: Answer | None = None
        self._answered = threading.Event()

    def answer(self, answer: Answer) -> None:
        """Answer it; the loop does, or who stands in for it."""
        self._answer = answer
        self._answered.set()
        self._told()

    def wait(self, timeout_s: float) -> Answer | None:
        """Wait for the answer; None if there is none in time."""
        self._answered.wait(timeout_s)
        return self._answer


class Mailbox:
    """Filled by any thread, emptied by the loop once a cycle."""

    def __init__(self) -> None:
        self._waiting: deque[Question] = deque()
        self._lock = threading.Lock()
        self._meanwhile: Callable[[str], Answer] | None = None

    def meanwhile(self, answer: Callable[[str], Answer] | None) -> None:
        """Let every order be answered by `answer`, on the asker's thread, while no loop runs; None: the loop does."""
        self._meanwhile = answer

    def ask(self, order: str, by: str = "", told: Callable[[], None] = lambda: None) -> Question:
        """Put an order to the loop. It is answered at once where there is no room for it, or no loop yet."""
        question = Question(order, by, told)
        meanwhile = self._meanwhile
        if meanwhile is not None:
            question.answer(meanwhile(order))
            return question
        with self._lock:
            if len(self._waiting) < MOST_WAITING:
                self._waiting.append(question)
                return question
        question.answer({"accepted": False, "order": order, "reason": "too many orders wait; is the loop running?"})
        return question

    def take(self) -> Sequence[Question]:
        """All that wait, oldest first."""
        with self._lock:
            taken = list(self._waiting)
            self._waiting.clear()
        return taken


ON_GROUND: Final = frozenset({State.CONNECTING, State.CHECKING, State.READY})
HANDOVER_LIMIT_S: Final = 12.0
"""After this the daemon goes anyway: its stream ends, and the autopilot's own failsafe acts."""

ORDER_OF: Final = {"hold": Event.HOLD, "land": Event.LAND, "return": Event.RETURN}

_TAKEN: Final = {State.HOLDING: Mode.HOLD, State.RETURNING: Mode.RETURN, State.LANDING: Mode.LAND}


class ShutdownHandover:
    """The memory of an ending: which order was meant, whether it was given, and since when."""

    def __init__(self, order: Event, now_s: float) -> None:
        self._order = order
        self._since_s = now_s
        self._given = False

    def orders(self, flight: Flight) -> tuple[Event, ...]:
        """The order that hands the vehicle over, once."""
        if self._given or flight.state in FINAL | ON_GROUND:
            return ()
        self._given = True
        # What is just arming has not left the ground: nothing is to be handed over, only called off.
        return (Event.ABORT if flight.state is State.ARMING else self._order,)

    def finished(self, flight: Flight, now_s: float) -> bool:
        """True once there is nothing more to hand over, or no more time."""
        if flight.state in FINAL | ON_GROUND or now_s - self._since_s > HANDOVER_LIMIT_S:
            return True
        taken = _TAKEN.get(flight.state)
        return taken is not None and flight.mode_name == str(taken)
