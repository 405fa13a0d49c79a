"""Guidance as a flight mode of PX4: our readiness is its arming check, and the pilot's switch is START and ENGAGE.

Arming in the mode on the ground is the order start. Choosing it in the air is the orders start, if guidance has not
taken the vehicle over yet, and engage. An order that is refused then is followed by hold, so that the vehicle does not
stay in a mode that no program flies. Leaving the mode is a pilot's mode change, which the flight never fights.
"""

from collections.abc import Sequence
from typing import Final

from guidance.autopilots import Mode, Verdict
from guidance.flight import BEFORE_FLIGHT, FINAL, Event, Flight, State
from guidance.flight.table import HANDING_OVER, SETPOINT_STATES
from guidance.links.px4.link import Px4Link
from guidance.links.px4.mode import Check, Readiness
from guidance.log.sink import Report, Sink
from guidance.session.orders.mailbox import Mailbox, Question
from guidance.session.orders.words import STATUS

PILOT: Final = "the pilot's switch"
"""Sender of the orders."""

REASONS_EVERY_S: Final = 0.5
"""Period of asking which row of preflight refuses."""

_FENCE_ROWS: Final = ("GF_", "uploaded fence", "home in our fence")
_CHECKS: Final = {
    "Home": Check.HOME,
    "battery": Check.BATTERY,
    "fence": Check.FENCE,
    # PX4 itself shows its own checks
    "prearm": None,
}
"""Readiness checks that are not about the link or the position."""


class FlightModeOutput(Sink):
    """Tells a link whether the mode may be entered, and turns the pilot's switch into orders.

    Args:
        link: To the vehicle.
        mailbox: Where orders go.
    """

    def __init__(self, link: Px4Link, mailbox: Mailbox) -> None:
        self._link = link
        self._mailbox = mailbox
        self._status: Question | None = None
        self._status_s = float("-inf")
        self._refused: Sequence[str] = ()
        self._was_chosen = False
        self._asked: Question | None = None

    def report(self, report: Report) -> None:
        """Judge the readiness of this cycle, and follow the pilot's switch."""
        flight = report.flight
        now_s = report.now_s
        if flight.state in BEFORE_FLIGHT:
            # The daemon answers in its next cycle which rows of preflight refuse.
            if self._status is not None and self._status.done():
                self._refused = self._status.result().get("preflight_refused", ())
                self._status = None
            if self._status is None and now_s - self._status_s >= REASONS_EVERY_S:
                self._status_s = now_s
                self._status = self._mailbox.ask(STATUS)
        self._link.tell(Readiness(now_s, checks_of(flight, now_s, self._refused)))
        chosen = flight.observed.mode is Mode.GUIDED and flight.vehicle.armed
        is_new = chosen and not self._was_chosen
        self._was_chosen = chosen
        if not chosen or flight.state in SETPOINT_STATES:
            self._asked = None
        elif is_new:
            # The order that a new choice of the mode means; None if guidance itself asked for the mode.
            if flight.state in {State.STANDING_BY, State.HOLDING}:
                order = Event.ENGAGE
            elif flight.state in {State.CONNECTING, State.CHECKING, State.READY}:
                order = Event.START
            else:
                order = None
            self._asked = None if order is None else self._mailbox.ask(order, PILOT)
        elif self._asked is not None and self._asked.done():
            answered = self._asked
            self._asked = None
            if answered.order != Event.HOLD:
                if not answered.result()["accepted"]:
                    self._asked = self._mailbox.ask(Event.HOLD, PILOT)
                elif answered.order == Event.START and flight.state is State.STANDING_BY:
                    self._asked = self._mailbox.ask(Event.ENGAGE, PILOT)


def checks_of(flight: Flight, now_s: float, refused: Sequence[str]) -> tuple[Check, ...]:
    """Return the checks that bar the mode; none while guidance flies in it or hands over.

    Args:
        flight: As it stands.
        now_s: The present.
        refused: Names of preflight's rows that refuse.
    """
    state = flight.state
    handing_over = state in HANDING_OVER and flight.observed.mode is Mode.GUIDED
    on_ground = flight.vehicle.on_ground
    taking_off = state is State.ARMING or (state is State.CLIMBING and on_ground)
    if state in SETPOINT_STATES or handing_over or taking_off:
        return ()
    if state in FINAL | {State.CLIMBING, State.POSITIONING, State.RETURNING, State.LANDING}:
        return (Check.BUSY,)
    checks = list[Check]()
    if state in BEFORE_FLIGHT and state is not State.READY:
        rows = flight.checks(now_s)
        failed = [
            _CHECKS.get(row.name, Check.POSITION) for row in rows if row.verdict is not Verdict.PASS
        ]
        failed += [Check.FENCE if name.startswith(_FENCE_ROWS) else Check.SETUP for name in refused]
        checks += [check for check in failed if check is not None]
        if not checks:
            checks.append(Check.SETUP)
    if state is State.OUT_OF_CONTACT or flight.telemetry_refusal(now_s):
        checks.append(Check.POSITION)
    if flight.evader_refusal(now_s):
        checks.append(Check.EVADER)
    return tuple(dict.fromkeys(checks))
