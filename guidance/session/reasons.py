"""Why an order had no effect, and what to do next: the answer a person gets."""

from collections.abc import Mapping, Sequence
from typing import Final

from guidance.flight import FINAL, TRANSITIONS, Event, Flight, State
from guidance.preflight import Finding, advice

_WHY: Final[Mapping[State, str]] = {
    State.CONNECTING: "the vehicle is not heard",
    State.ARMING: "it is arming",
    State.CLIMBING: "it is taking off",
    State.POSITIONING: "it is on its way to the start",
    State.STANDING_BY: "it stands by: order engage, hold, land or return",
    State.ENTERING: "it is entering the guided mode",
    State.ENGAGED: "the game is on",
    State.PAUSED: "the game is paused",
    State.ON_STATION: "it is on station",
    State.HOLDING: "it holds: order engage, land or return",
    State.RETURNING: "it is returning",
    State.LANDING: "it is landing",
}


def is_done(order: Event, state: State) -> bool:
    """True where the flight is already in the state that an order leads to: ordering twice does no harm."""
    return any(event is order and after is state for (_, event), after in TRANSITIONS.items())


def refusal(order: Event, flight: Flight, now_s: float, rows: Sequence[Finding]) -> str:
    """Say why `order` changed nothing."""
    state = flight.state
    if flight.fault is not None:
        return f"guidance failed ({flight.fault}), and is silent since: order reset to begin another"
    if state in FINAL:
        ended = {
            State.YIELDED: "a pilot or the autopilot took over, and guidance is silent since",
            State.FAILED: "the flight could not be flown",
            State.LANDED: "the flight is over",
        }[state]
        return f"{ended}: order reset to begin another"
    if state is State.CHECKING:
        return f"not ready: {missing(flight, now_s, rows)}"
    if state is State.READY:
        return "on the ground: order start first" if order is Event.ENGAGE else "there is no flight to end: it is ready"
    if order is Event.START:
        return f"under way already: {_WHY[state]}"
    return _WHY[state]


def missing(flight: Flight, now_s: float, rows: Sequence[Finding]) -> str:
    """Name every check that fails and every preflight row that is refused."""
    checks = [f"{check.name} ({check.found})" for check in flight.checks(now_s) if not check.passed]
    return "; ".join(filter(None, (", ".join(checks), advice(rows)))) or "the checks have just passed, order again"


def not_engageable(flight: Flight, now_s: float) -> str | None:
    """Say what stands against engaging where the state would allow it; None if nothing does."""
    silence_s = flight.tracking.silence_s(now_s)
    limit_s = flight.settings.cycle.evader_timeout_s
    if silence_s > limit_s:
        heard = "was never heard" if silence_s == float("inf") else f"was last heard {silence_s:.1f} s ago"
        return f"the evader {heard}; at most {limit_s:g} s is allowed"
    return None
