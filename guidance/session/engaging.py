"""Before the game begins the autopilot is looked at once more: its fence, and what it does when setpoints stop.

Preflight read these parameters on the ground, and whoever has a ground station may have changed them since. So an
engage order waits until all of them were read again, and a pilot's switch to the guided mode engages no sooner. That
takes as long as the autopilot takes to answer; a parameter that does not answer is a refusal.
"""

from typing import Final

from guidance.autopilots import Finding, Mode, Wants
from guidance.flight import EngageOn, Flight, State
from guidance.preflight import PreflightMemory, engage_names, engage_rows, refusals
from guidance.session.orders import Question

READ_WITHIN_S: Final = 1.5
"""In this time a link asks three times, and whoever ordered still waits for the answer."""

_BEING_READ: Final = ("parameters read again",)


class Engaging:
    """What waits for the parameters of one vehicle to be read again, and what they were found to be.

    Args:
        flight: Of the vehicle.
        survey: What asks for its parameters.
        wants: What they are judged by; where that is None nothing is read.
    """

    def __init__(self, flight: Flight, survey: PreflightMemory, wants: Wants | None) -> None:
        self._flight = flight
        self._survey = survey
        self._wants = wants
        self._names = engage_names(flight.settings.autopilot)
        self._waiting: list[Question] = []
        self._asked_s: float | None = None
        self._to_pilot: tuple[str, ...] | None = None
        self.rows: tuple[Finding, ...] = ()

    @property
    def reading(self) -> bool:
        """Whether answers are waited for."""
        return self._asked_s is not None

    def wait(self, question: Question, now_s: float) -> None:
        """Let an order wait until everything was read again."""
        self._waiting.append(question)
        self._read(now_s)

    def give_up(self) -> tuple[Question, ...]:
        """Return the orders that wait; they will not be given."""
        waiting, self._waiting = tuple(self._waiting), []
        return waiting

    def due(self, now_s: float) -> tuple[Question, ...]:
        """Judge what was read as soon as nothing is missing or the time is up; return the orders to give then."""
        piloted = self._for_a_pilot and self._flight.mode_name == Mode.GUIDED
        if not piloted:
            self._to_pilot = None
        elif self._to_pilot is None:
            self._read(now_s)
        if self._asked_s is None or not (self._survey.complete or now_s - self._asked_s >= READ_WITHIN_S):
            return ()
        self._asked_s = None
        if self._wants is not None:
            facts = self._survey.facts(self._flight.vehicle, now_s)
            self.rows = engage_rows(facts, self._flight.settings.autopilot, self._wants)
        if piloted:
            self._to_pilot = refusals(self.rows)
        return self.give_up()

    @property
    def bars_the_pilot(self) -> tuple[str, ...]:
        """What a pilot's switch to the guided mode does not engage for."""
        if not self._for_a_pilot:
            return ()
        return _BEING_READ if self._to_pilot is None else self._to_pilot

    @property
    def _for_a_pilot(self) -> bool:
        flight = self._flight
        piloted = flight.settings.engage_on is EngageOn.PILOT_MODE and flight.state is State.STANDING_BY
        return self._wants is not None and piloted

    def _read(self, now_s: float) -> None:
        if self._asked_s is None:
            self._asked_s = now_s
            self._survey.forget(self._names)
