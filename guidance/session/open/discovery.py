"""A running vehicle, before any order: which autopilot it has, where it stands, and a first vehicle file for it.

The vehicle file is the bundled one with the limits of the autopilot.
"""

import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import tomlkit

from guidance.autopilots import (
    AUTOPILOTS,
    Autopilot,
    Version,
    autopilot_named,
    autopilots_of,
)
from guidance.autopilots.description import GPS_GLOBAL_ORIGIN, HOME_POSITION
from guidance.clock import Clock, MonotonicClock
from guidance.config import config_folder, parse_document
from guidance.control.limits import CATCH_UP_RATIO
from guidance.errors import ConfigError, FlightError, LinkError
from guidance.files import writing
from guidance.flight import State
from guidance.frames import LocalFrame
from guidance.links.opening import Found, find_autopilot, open_link, open_wire
from guidance.links.port import VehicleLink, Wire
from guidance.messages import Heartbeat, Home, LandedState, Message, Origin, StatusText
from guidance.preflight import PreflightMemory
from guidance.session.fly.mission import Progress
from guidance.session.vehicle_file import Config
from guidance.vehicle import VehicleState, local_frame, observe

FOUND_WITHIN_S: Final = 15.0
DISCOVERED_WITHIN_S: Final = 10.0

PLACED_WITHIN_S: Final = 120.0
"""Longest wait for a position. An ArduCopter takes 25 to 45 s after its start."""

_ASK_EVERY_S: Final = 1.0
_LOOK_EVERY_S: Final = 0.05
_BEHIND_M: Final = 5.0
"""Distance of our fence from the autopilot's fence around it."""

_LANDED_STATE_WITHIN_S: Final = 3.0
_AUTOPILOT_COMPONENT: Final = 1
_MOST_NAMED: Final = 8
"""Most HEARTBEATs of others that an error names."""

_NAMES: Final[dict[type[Message], str]] = {
    Heartbeat: "HEARTBEAT",
    Home: "HOME_POSITION",
    Origin: "GPS_GLOBAL_ORIGIN",
    LandedState: "EXTENDED_SYS_STATE",
}


@contextmanager
def autopilot_at(
    url: str, asked: str | None, clock: Clock, *, who: str
) -> Iterator[tuple[Wire, Found, Autopilot]]:
    """Find the autopilot at a URL; the wire is closed in the end.

    Cameras and gimbals on the same wire are passed over. They are named only if no autopilot is heard in time.

    Args:
        url: See `guidance.links.port`.
        asked: Name of the expected autopilot; None accepts any.
        clock: The clock.
        who: Names it in errors.

    Yields:
        Its wire, the contents of its HEARTBEAT, and its description.

    Raises:
        ConfigError: If the URL is wrong, or `identify` refuses every autopilot that was heard.
        LinkError: If nothing answers.
    """
    refusals: dict[Found, str] = {}

    def fits(sender: Found) -> bool:
        try:
            identify(sender, url, asked)
        except ConfigError as error:
            if len(refusals) < _MOST_NAMED:
                refusals[sender] = str(error)
            return False
        return True

    with closing(open_wire(url, clock=clock.now_s)) as wire:
        try:
            sender = find_autopilot(
                wire,
                clock=clock.now_s,
                timeout_s=FOUND_WITHIN_S,
                sleep=lambda wait_s: clock.sleep_until(clock.now_s() + wait_s),
                who=who,
                fits=fits,
            )
        except LinkError:
            if not refusals:
                raise
            raise ConfigError("; ".join(refusals.values())) from None
        yield wire, sender, identify(sender, url, asked)


def identify(found: Found, url: str, asked: str | None) -> Autopilot:
    """Return the autopilot that was found.

    Args:
        found: The autopilot, from its HEARTBEAT.
        url: Where, for the message.
        asked: Name of the expected autopilot; None accepts any.

    Raises:
        ConfigError: If it is an unknown autopilot or vehicle type, or not the expected one.
    """
    expected = None if asked is None else autopilot_named(asked)
    sender = f"{url}: system {found.system_id}"
    if found.component_id != _AUTOPILOT_COMPONENT:
        sender += f", component {found.component_id}"
    matching = autopilots_of(found.autopilot)
    if not matching:
        supported = " and ".join(
            f"{autopilot.name} ({autopilot.autopilot_id})" for autopilot in AUTOPILOTS.values()
        )
        raise ConfigError(f"{sender} is MAV_AUTOPILOT {found.autopilot}; supported are {supported}")
    supporting = [
        autopilot for autopilot in matching if found.vehicle_type in autopilot.vehicle_types
    ]
    if not supporting:
        raise ConfigError(
            f"{sender} is MAV_TYPE {found.vehicle_type}: {matching[0].name} is flown as a multicopter only"
        )
    if expected is None:
        return supporting[0]
    if expected not in supporting:
        raise ConfigError(
            f"{sender} is {supporting[0].name}, not --autopilot {asked}: omit it, or give another --vehicle"
        )
    return expected


def wait_until_placed(
    link: VehicleLink,
    profile: Autopilot,
    clock: Clock,
    show: Callable[[Progress], None],
    vehicle: str = "",
) -> tuple[Home, LocalFrame]:
    """Wait for the home and the local frame of a vehicle that is disarmed on the ground.

    Args:
        link: To the vehicle.
        profile: Of its autopilot.
        clock: The clock.
        show: Receives the progress.
        vehicle: Its name, for the progress.

    Raises:
        FlightError: If it is in the air, armed, or has no position in time. No order was given then.
    """
    state = VehicleState()
    text = ""
    waiting = ""
    requested_s = -math.inf
    begun_s = clock.now_s()
    for now_s, messages in _heard(link, clock, PLACED_WITHIN_S):
        if now_s - requested_s >= _ASK_EVERY_S:
            requested_s = now_s
            link.send_heartbeat()
            for request in profile.stream_requests():
                link.request(request)
            link.request(profile.request_message(HOME_POSITION))
            link.request(profile.request_message(GPS_GLOBAL_ORIGIN))
        # Other programs may send HEARTBEATs with the autopilot's ids.
        state = observe(
            state,
            [
                message
                for message in messages
                if not isinstance(message, Heartbeat) or profile.speaks(message)
            ],
        )
        waited_s = now_s - begun_s
        texts = [message.text for message in messages if isinstance(message, StatusText)]
        text = texts[-1] if texts else text
        # An armed vehicle is refused, at the latest when it does not say whether it is in the air.
        if state.armed:
            landed_state_known = state.latest.get(LandedState) is not None
            if landed_state_known and not state.on_ground:
                raise FlightError(
                    "the vehicle is in the air already: land and disarm it first; no order was given"
                )
            if landed_state_known or waited_s > _LANDED_STATE_WITHIN_S:
                raise FlightError(
                    "the vehicle was armed by someone else: disarm it first; no order was given"
                )
        missing = [name for kind, name in _NAMES.items() if state.age_s(kind, now_s) > waited_s]
        home = state.latest.get(Home)
        frame = local_frame(state, profile.projection)
        if not missing and home is not None and frame is not None:
            return home, frame
        waiting = f"{', '.join(missing)} not received: no position fix yet?"
        if text:
            waiting += f' It says "{text}"'
        beat = state.latest.get(Heartbeat)
        title = "unknown" if beat is None else profile.mode_title(profile.mode_of(beat.custom_mode))
        show(Progress(now_s, State.CONNECTING, title, None, "s", waiting=waiting, vehicle=vehicle))
    raise FlightError(f"not ready within {PLACED_WITHIN_S:g} s: {waiting} Nothing was armed")


def _heard(
    link: VehicleLink, clock: Clock, within_s: float
) -> Iterator[tuple[float, Sequence[Message]]]:
    """Yield the time and the vehicle's new messages, again and again until the time is over."""
    begun_s = clock.now_s()
    while (now_s := clock.now_s()) - begun_s <= within_s:
        yield now_s, link.receive()
        clock.sleep_until(now_s + _LOOK_EVERY_S)


class Surveyed(NamedTuple):
    """An autopilot that answered, with the parameters that bound a vehicle file, in its version."""

    autopilot: str
    found: Found
    parameters: Mapping[str, float]
    version: Version


def survey(url: str, asked: str | None = None) -> Surveyed:
    """Find the autopilot at a URL and read its limits. Sets and orders nothing.

    Args:
        url: See `guidance.links.port`.
        asked: Name of the expected autopilot.

    Raises:
        ConfigError: If the URL is wrong or the autopilot unknown.
        LinkError: If nothing answers.
    """
    clock = MonotonicClock()
    with autopilot_at(url, asked, clock, who=url) as (wire, sender, profile):
        memory = PreflightMemory(profile, bound_parameters)
        sender_words = f"{url}: system {sender.system_id}"
        ids: dict[str, Any] = {"system_id": sender.system_id, "component_id": sender.component_id}
        ids["autopilot"] = profile.autopilot_id
        with closing(
            open_link(wire, "pymavlink", clock=clock.now_s, who=sender_words, **ids)
        ) as link:
            link.send_heartbeat()
            # An old firmware may lack a parameter
            for now_s, messages in _heard(link, clock, DISCOVERED_WITHIN_S):
                memory.observe(messages, ())
                if memory.complete:
                    break
                for request in memory.requests(now_s):
                    link.request(request)
    facts = memory.facts(VehicleState(), clock.now_s())
    return Surveyed(profile.name, sender, facts.parameters, memory.version)


def bound_parameters(version: Version) -> tuple[str, ...]:
    """Return the names of the parameters that bound a new vehicle file."""
    return tuple(bound.parameter for bound in version.bounds)


def vehicle_file(
    autopilot: str, *, name: str, url: str | None = None, surveyed: Surveyed | None = None
) -> str:
    """Return the text of a commented vehicle file, checked as in `guidance run`.

    Args:
        autopilot: Name of the autopilot.
        name: Name of the vehicle in orders, metrics and records.
        url: Its URL; None keeps the bundled one.
        surveyed: The limits that were read, if any.

    Raises:
        ConfigError: If the name, the URL or the autopilot is wrong.
    """
    autopilot_named(autopilot)
    # An autopilot from outside has no file of its own.
    folder = config_folder() / "vehicles"
    template = folder / f"{autopilot}.toml"
    if not template.is_file():
        template = folder / "px4.toml"
    document = tomlkit.parse(template.read_text(encoding="utf-8"))
    changes = [
        _Change("", "name", name, "in orders, metrics and records"),
        _Change("vehicle", "autopilot", autopilot),
    ]
    if url is not None:
        changes.append(_Change("vehicle", "url", url))
    head = [
        "A vehicle file of pursuit guidance. Every key has its unit; `guidance schema vehicle` describes all keys."
    ]
    if surveyed is None:
        head.append(f"Written without a vehicle: the limits are the bundled ones for {autopilot}.")
    else:
        system_id = surveyed.found.system_id
        changes.append(_Change("vehicle", "system_id", system_id, "from its HEARTBEAT"))
        changes += _bounded(document.unwrap(), surveyed)
        head.append(f"Read from system {system_id}, {autopilot}:")
        for parameter in bound_parameters(surveyed.version):
            value = surveyed.parameters.get(parameter)
            head.append(f"  {parameter:<18} {'not read' if value is None else f'{value:g}'}")
    for change in changes:
        table: Any = document[change.section] if change.section else document
        table[change.key] = change.value
        if change.comment:
            item = table[change.key]
            item.comment(change.comment)
            item.trivia.comment_ws = "  "
    keys = document.as_string()
    keys = keys[keys.index("name = ") :]
    comments = "".join(f"# {line}\n" for line in head)
    parse_document(Config, tomllib.loads(keys), source="the vehicle file")
    return f"{comments}\n{keys}"


class _Change(NamedTuple):
    """Another value of a key, and the comment on it; without one, the key's present comment stays."""

    section: str
    key: str
    value: str | int | float
    comment: str = ""


def write_new(path: Path, text: str) -> None:
    """Write a new file.

    Raises:
        ConfigError: If it exists.
        OutputError: If it cannot be written.
    """
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            path.open("x").close()
        except FileExistsError as error:
            raise ConfigError(
                f"--out {path}: exists and is not overwritten; choose another name"
            ) from error
        path.write_text(text, encoding="utf-8")


def _bounded(template: Mapping[str, Any], surveyed: Surveyed) -> Iterator[_Change]:
    """Yield the keys whose bound was read, with the largest allowed value, at most the template's own."""
    for section, key, parameter, scale in surveyed.version.bounds:
        read = surveyed.parameters.get(parameter)
        if read is None:
            continue
        bound = read * scale
        value = template[section][key]
        comment = f"{parameter} is {read:g}"
        if section != "limits":
            value = min(value, math.floor(10.0 * bound / CATCH_UP_RATIO) / 10.0)
        elif bound > _BEHIND_M:
            value = min(value, math.floor(bound - _BEHIND_M))
        if section == "limits" and read == 0.0:
            comment += ", which is off: guidance check refuses it"
        yield _Change(section, key, round(value, 1), comment)
        if key == "ceiling_m" and value < template["flight"]["takeoff_height_m"]:
            comment = "not above limits.ceiling_m"
            yield _Change("flight", "takeoff_height_m", round(value, 1), comment)
            yield _Change("game", "standoff_height_m", round(value, 1), comment)
        if key == "speed_m_s" and value <= template["game"]["evader_speed_m_s"]:
            comment = "must be slower than the pursuer"
            yield _Change("game", "evader_speed_m_s", round(value / 2.0, 2), comment)
