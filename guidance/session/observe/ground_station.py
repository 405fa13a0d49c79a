"""Messages about a flight to ground stations on the vehicle's link, and orders from those that may give them.

The service is an onboard computer there: it sends a HEARTBEAT once a second and a STATUSTEXT at each change of the
state and at each alarm. `vehicle.announce` shows the evader on their maps. Custom actions of QGroundControl are orders.
"""

import json
from collections import deque
from collections.abc import Mapping
from typing import Final, NamedTuple

from guidance.flight import (
    FINAL,
    Authority,
    Event,
    FlightSettings,
    Outputs,
    State,
    Transition,
)
from guidance.flight.table import HANDING_OVER
from guidance.links.mavlink.ground_link import GroundLink, StationCommand
from guidance.log.sink import FlightIdentity, Report, Sink
from guidance.session.observe.severe import SEVERE
from guidance.session.orders.mailbox import Mailbox, Question

ORDERS_BY_COMMAND: Final[Mapping[int, Event]] = {
    31010: Event.HOLD,
    31011: Event.RETURN,
    31012: Event.LAND,
    31013: Event.START,
    31014: Event.ENGAGE,
}
"""Orders by MAV_CMD_USER_1 to MAV_CMD_USER_5."""

SIGNED_ONLY: Final = frozenset({Event.START, Event.ENGAGE})
"""Orders that only a signed link brings: they begin something. The others end it."""

CRITICAL: Final = 2
WARNING: Final = 4
NOTICE: Final = 5
INFO: Final = 6
"""MAV_SEVERITY."""

RESULT_ACCEPTED: Final = 0
TEMPORARILY_REJECTED: Final = 1
DENIED: Final = 2
UNSUPPORTED: Final = 3
"""MAV_RESULT."""

_HEARTBEAT_EVERY_S: Final = 1.0
EVADER_EVERY_S: Final = 0.5
TEXT_EVERY_S: Final = 0.2
SAME_TEXT_EVERY_S: Final = 5.0
REPEATED_WITHIN_S: Final = 10.0
"""A sender that lost the answer repeats its command within this time."""

MOST_TEXTS: Final = 8
_MOST_ORDERS: Final = 8

_WORDS: Final[Mapping[State, str]] = {
    State.HOLDING: "held",
    State.RETURNING: "returns",
    State.LANDING: "lands",
    State.FAILED: "failed",
}
"""Words for states on ground stations; every other state has its own word."""

_LOUD: Final = frozenset({State.ENGAGED, State.ON_STATION, State.HOLDING, State.YIELDED})
"""States that an operator should notice, for any cause."""


class _Text(NamedTuple):
    severity: int
    words: str


class GroundStationOutput(Sink):
    """The output of one vehicle.

    Args:
        link: To the ground stations; closed with the output.
        mailbox: Where orders go.
        announce: Whether the evaders are shown on maps.
    """

    def __init__(self, link: GroundLink, mailbox: Mailbox, *, announce: bool) -> None:
        self._link = link
        self._mailbox = mailbox
        self._announce = announce
        self._call_sign = ""
        self._unit = "s"
        self._texts = deque[_Text]()
        self._said_s: dict[str, float] = {}
        self._asked: dict[StationCommand, Question] = {}
        self._accepted_s: dict[StationCommand, float] = {}
        self._in_force: StationCommand | None = None
        self._heartbeat_s = float("-inf")
        self._evader_s = float("-inf")
        self._last_text_s = float("-inf")

    def begin(self, identity: FlightIdentity) -> None:
        """Take the stand-off and the kind of the game."""
        self._call_sign = call_sign(identity.settings)
        self._unit = "s" if identity.settings.cycle.target_game_m is None else "m"
        self._in_force = None

    def report(self, report: Report) -> None:
        """Announce the cycle's changes, and read and answer orders."""
        now_s = report.now_s
        if now_s - self._heartbeat_s >= _HEARTBEAT_EVERY_S:
            self._heartbeat_s = now_s
            self._link.send_heartbeat()
        for text in texts_of(report.outputs, self._unit):
            self._keep(now_s, text)
        for transition in report.outputs.transitions:
            if transition.after is transition.before:
                continue
            # An order that changes the state, a handover or a final state ends the order in force.
            ordered = transition.event in ORDERS_BY_COMMAND.values()
            if ordered or transition.after in HANDING_OVER | FINAL:
                self._in_force = None
        self._answer(now_s)
        for command in self._link.receive():
            self._take(now_s, command)
        if self._texts and now_s - self._last_text_s >= TEXT_EVERY_S:
            self._last_text_s = now_s
            text = self._texts.popleft()
            self._link.send_text(*text)
        if self._announce and now_s - self._evader_s >= EVADER_EVERY_S:
            self._evader_s = now_s
            # An evader that is silent is not shown where it may no longer be.
            tracking = report.flight.tracking
            frame = tracking.local_frame
            if frame is not None:
                for name in evaders_of(report.flight.settings):
                    evader = tracking.evader(now_s, name)
                    if (
                        evader is None
                        or evader.age_s > report.flight.settings.cycle.evader_timeout_s
                    ):
                        continue
                    position = frame.wgs84_from_ned(evader.position_ned_m)
                    velocity_ned_m_s = evader.velocity_ned_m_s
                    self._link.send_evader(
                        name, position, velocity_ned_m_s, evader.age_s, self._call_sign
                    )

    def over(self, _now_s: float, detail: str) -> None:
        """Say how the flight ended."""
        self._link.send_text(NOTICE, f"guidance: ended: {json.loads(detail)['ended']}")

    def close(self) -> None:
        """Leave the link; may be called twice."""
        self._link.close()

    def _keep(self, now_s: float, text: _Text) -> None:
        """Keep a text to be sent, unless the same one was kept a moment ago; of too many the oldest is dropped."""
        if now_s - self._said_s.get(text.words, float("-inf")) < SAME_TEXT_EVERY_S:
            self.dropped += 1
            return
        self._said_s = {
            words: said_s
            for words, said_s in self._said_s.items()
            if now_s - said_s < SAME_TEXT_EVERY_S
        }
        self._said_s[text.words] = now_s
        self._texts.append(text)
        if len(self._texts) > MOST_TEXTS:
            self._texts.popleft()
            self.dropped += 1

    def _take(self, now_s: float, command: StationCommand) -> None:
        """Forward an order, or answer why not.

        A repeated command is no second order while the first one is in force. After that it ends a flight again, but
        it begins nothing: a person may have ended it since.
        """
        first = command.first
        if first in self._asked:
            return
        accepted_s = self._accepted_s.get(first, float("-inf"))
        was_accepted = command.repeated and now_s - accepted_s < REPEATED_WITHIN_S
        order = ORDERS_BY_COMMAND.get(command.command)
        if was_accepted and first == self._in_force:
            self._link.answer(command, RESULT_ACCEPTED)
        elif order is None:
            self._link.answer(command, UNSUPPORTED)
        elif order in SIGNED_ONLY and not command.signed:
            self._link.answer(command, DENIED)
            words = f"guidance: {order} refused: only over a signed link"
            self._keep(now_s, _Text(WARNING, words))
        elif was_accepted and order in SIGNED_ONLY:
            self._link.answer(command, TEMPORARILY_REJECTED)
            words = f"guidance: {order} refused: ended since; order anew"
            self._keep(now_s, _Text(WARNING, words))
        elif len(self._asked) >= _MOST_ORDERS:
            self.dropped += 1
            self._link.answer(command, TEMPORARILY_REJECTED)
        else:
            by = f"ground station {command.system_id}"
            self._asked[first] = self._mailbox.ask(order, by)

    def _answer(self, now_s: float) -> None:
        """Answer the orders that the flight has answered."""
        for command, question in list(self._asked.items()):
            if not question.done():
                continue
            del self._asked[command]
            answer = question.result()
            if answer["accepted"]:
                self._accepted_s = {
                    earlier: at_s
                    for earlier, at_s in self._accepted_s.items()
                    if now_s - at_s < REPEATED_WITHIN_S
                }
                self._accepted_s[command] = now_s
                self._in_force = command
                self._link.answer(command, RESULT_ACCEPTED)
                continue
            self._link.answer(command, TEMPORARILY_REJECTED)
            words = f"guidance: {question.order} refused: {answer.get('reason', '')}"
            self._keep(now_s, _Text(WARNING, words))


def evaders_of(settings: FlightSettings) -> tuple[str, ...]:
    """Return the names of the evaders; the only one of a vehicle without a team has none."""
    return tuple(settings.evaders) if settings.evaders else ("",)


def call_sign(settings: FlightSettings) -> str:
    """Return the stand-off as a call sign: radius and height in metres, as R8H10."""
    standoff = settings.cycle.game.standoff
    return f"R{standoff.radius_m:.3g}H{standoff.height_m:.3g}"


def texts_of(outputs: Outputs, unit: str) -> list[_Text]:
    """Return the texts of a cycle: each change of the state, and an alarm.

    Args:
        outputs: Of the cycle.
        unit: Of the game's value: s in PE, m in TAD.
    """
    texts = []
    if outputs.alarm is not None:
        texts.append(_Text(WARNING, f"guidance: alarm: {outputs.alarm.words}"))
    for transition in outputs.transitions:
        if transition.after is not transition.before:
            state = _WORDS.get(transition.after, str(transition.after))
            if transition.by is Authority.OPERATOR:
                change_words = f"{state} by operator"
            elif transition.after is State.ENGAGED and outputs.certificate is not None:
                if unit == "s":
                    promise_words = f"{outputs.certificate.time_needed_s:.0f} s to stand-off"
                else:
                    promise_words = (
                        f"evader {outputs.certificate.assured_distance_m:.0f} m from its target"
                    )
                change_words = f"{state}, {promise_words}"
            elif transition.event in SEVERE:
                change_words = f"{state}: {transition.words}"
            else:
                change_words = state
            words = f"guidance: {change_words}"
            texts.append(_Text(severity_of(transition), words))
        elif transition.event is Event.HOME_MOVED:
            texts.append(_Text(WARNING, f"guidance: {transition.words}"))
    return texts


def severity_of(transition: Transition) -> int:
    """Return the MAV_SEVERITY of a change of the state."""
    if transition.event is Event.FAULT:
        return CRITICAL
    if transition.event in SEVERE:
        return WARNING
    return NOTICE if transition.after in _LOUD else INFO
