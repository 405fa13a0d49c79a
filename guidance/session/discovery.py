"""Finds out which autopilot a running vehicle has and where it stands, before any order."""

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import Final

from guidance.autopilots import AUTOPILOTS, Autopilot, AutopilotProfile, autopilot_named, autopilots_of
from guidance.autopilots.description import GPS_GLOBAL_ORIGIN, HOME_POSITION
from guidance.clock import Clock
from guidance.errors import ConfigError, FlightError
from guidance.flight import State
from guidance.frames import LocalFrame
from guidance.links.opening import Found, find_autopilot, open_wire
from guidance.links.port import VehicleLink, Wire
from guidance.messages import Heartbeat, Home, LandedState, Message, Origin, StatusText
from guidance.session.mission import Progress
from guidance.vehicle import VehicleState, local_frame, observe

FOUND_WITHIN_S: Final = 15.0
_CONNECTED_WITHIN_S: Final = 5.0

PLACED_WITHIN_S: Final = 120.0
"""Longest wait for a position. An ArduCopter takes 25 to 45 s after its start."""

_ASK_EVERY_S: Final = 1.0
_LOOK_EVERY_S: Final = 0.05
_LANDED_STATE_WITHIN_S: Final = 3.0
_NAMES: Final[dict[type[Message], str]] = {
    Heartbeat: "HEARTBEAT",
    Home: "HOME_POSITION",
    Origin: "GPS_GLOBAL_ORIGIN",
    LandedState: "EXTENDED_SYS_STATE",
}


@contextlib.contextmanager
def autopilot_at(url: str, asked: str | None, clock: Clock, *, who: str) -> Iterator[tuple[Wire, Found, Autopilot]]:
    """Find the autopilot at a URL; the wire is closed in the end.

    Args:
        url: See `guidance.links.port`.
        asked: Name of the expected autopilot; None accepts any.
        clock: The clock.
        who: Names it in errors.

    Yields:
        Its wire, what its HEARTBEAT said, and its description.

    Raises:
        ConfigError: If the URL is wrong, or `identify` refuses the autopilot.
        LinkError: If nothing answers.
    """
    with contextlib.closing(open_wire(url, clock=clock.now_s, timeout_s=_CONNECTED_WITHIN_S)) as wire:
        found = find_autopilot(wire, clock=clock.now_s, timeout_s=FOUND_WITHIN_S, sleep=time.sleep, who=who)
        yield wire, found, identify(found, url, asked)


def identify(found: Found, url: str, asked: str | None) -> Autopilot:
    """Return the autopilot that was found.

    Args:
        found: What answered.
        url: Where, for the message.
        asked: Name of the expected autopilot; None accepts any.

    Raises:
        ConfigError: If it is an unknown autopilot or vehicle type, or not the expected one.
    """
    expected = None if asked is None else autopilot_named(asked)
    who = f"{url}: system {found.system_id}"
    matching = autopilots_of(found.autopilot)
    if not matching:
        known = " and ".join(f"{one.name} ({one.autopilot_id})" for one in AUTOPILOTS.values())
        raise ConfigError(f"{who} is MAV_AUTOPILOT {found.autopilot}; supported are {known}")
    flown = [one for one in matching if found.vehicle_type in one.vehicle_types]
    if not flown:
        raise ConfigError(f"{who} is MAV_TYPE {found.vehicle_type}: {matching[0].name} is flown as a multicopter only")
    if expected is not None and expected not in flown:
        raise ConfigError(f"{who} is {flown[0].name}, not --autopilot {asked}: omit it, or give another --vehicle")
    return expected or flown[0]


def wait_until_placed(
    link: VehicleLink,
    profile: AutopilotProfile,
    clock: Clock,
    show: Callable[[Progress], None],
    *,
    within_s: float = PLACED_WITHIN_S,
) -> tuple[Home, LocalFrame]:
    """Wait for the home and the local frame of a vehicle that is disarmed on the ground.

    Args:
        link: To the vehicle.
        profile: Of its autopilot.
        clock: The clock.
        show: Receives the progress.
        within_s: Longest wait.

    Raises:
        FlightError: If it is in the air, armed, or has no position in time. No order was given then.
    """
    state, said = VehicleState(), ""
    begun_s = now_s = clock.now_s()
    asked_s = float("-inf")
    asked = (*profile.stream_requests(), *map(profile.request_message, (HOME_POSITION, GPS_GLOBAL_ORIGIN)))
    while True:
        if now_s - asked_s >= _ASK_EVERY_S:
            asked_s = now_s
            link.send_heartbeat()
            for request in asked:
                link.request(request)
        messages = link.receive()
        state = observe(state, messages)
        said = next((each.text for each in reversed(messages) if isinstance(each, StatusText)), said)
        waited_s = now_s - begun_s
        _refuse_if_flown(state, waited_s)
        missing = [name for kind, name in _NAMES.items() if state.age_s(kind, now_s) > waited_s]
        home, frame = state.last(Home), local_frame(state, profile.projection)
        if not missing and home is not None and frame is not None:
            return home, frame
        words = f"{', '.join(missing)} not received: no position fix yet?" + (f' It says "{said}"' if said else "")
        if waited_s > within_s:
            raise FlightError(f"not ready within {within_s:g} s: {words} Nothing was armed")
        show(Progress(now_s, State.CONNECTING, _mode(state, profile), None, "s", waiting=words))
        clock.sleep_until(now_s + _LOOK_EVERY_S)
        now_s = clock.now_s()


def _refuse_if_flown(state: VehicleState, waited_s: float) -> None:
    told = state.last(LandedState) is not None
    if state.armed and told and not state.on_ground:
        raise FlightError("the vehicle is in the air already: land and disarm it first; no order was given")
    if state.armed and (told or waited_s > _LANDED_STATE_WITHIN_S):
        raise FlightError("the vehicle was armed by someone else: disarm it first; no order was given")


def _mode(state: VehicleState, profile: AutopilotProfile) -> str:
    heartbeat = state.last(Heartbeat)
    return "unknown" if heartbeat is None else profile.mode_title(profile.mode_of(heartbeat.custom_mode))
