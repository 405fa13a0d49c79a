"""PX4 events, which replace STATUSTEXT: a table from the mock's texts to the events that carry them.

An event id is the 24-bit FNV-1a hash of the event's name, with component 1 in the top byte, as in PX4 v1.17. Ids and
arguments were compared with recorded ones. Clients translate events by the autopilot's metadata.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

_AUTOPILOT: Final = 1 << 24
_FNV_SEED = 0x811C9DC5
_FNV_PRIME = 0x01000193
_LEVELS: Final = {0: 0x00, 1: 0x11, 2: 0x22, 3: 0x33, 4: 0x44, 5: 0x55, 6: 0x66}
_WARNINGS: Final = frozenset({"Connection to ground station lost"})
"""Texts of severity INFO whose events are warnings."""
_WARNING_OF_INFO = 0x64
_LEVELS_INSIDE: Final[Mapping[str, int]] = MappingProxyType(
    {
        "Arming denied: Resolve system health failures first": 6,
        "Disarming denied: not landed": 6,
        "Mission start denied! No valid mission": 6,
        "Reposition is outside geofence": 6,
        "Failsafe activated": 4,
    }
)
"""Log level of texts whose events PX4 logs at another level than it shows."""
_ARGUMENTS: Final = 40
_BY_COMMAND = 4
_BY_MISSION = 5
_BY_LANDING = 6
_BY_PREFLIGHT = 7


class Event(NamedTuple):
    """Fields of EVENT except sequence number and time: id, log levels and arguments."""

    id: int
    levels: int
    arguments: bytes


_NAMES: Final[Mapping[str, tuple[str, bytes]]] = MappingProxyType(
    {
        "Armed by external command": ("commander_armed_by", bytes((_BY_COMMAND,))),
        "Armed by mission start": ("commander_armed_by", bytes((_BY_MISSION,))),
        "Disarmed by external command": ("commander_disarmed_by", bytes((_BY_COMMAND,))),
        "Disarmed by landing": ("commander_disarmed_by", bytes((_BY_LANDING,))),
        "Disarmed by auto preflight disarming": ("commander_disarmed_by", bytes((_BY_PREFLIGHT,))),
        "Takeoff detected": ("commander_takeoff_detected", b""),
        "Landing detected": ("commander_landing_detected", b""),
        "Returning to launch": ("commander_rtl", b""),
        "Landing at current position": ("commander_landing_current_pos", b""),
        "Precision landing": ("commander_landing_prec_land", b""),
        "Arming denied: Resolve system health failures first": (
            "commander_arm_denied_resolve_failures",
            b"",
        ),
        "Disarming denied: not landed": ("commander_disarm_denied_not_landed", b""),
        "Mission start denied! No valid mission": (
            "commander_mission_start_denied_no_mission",
            b"",
        ),
        "Unsupported auto mode": ("commander_unsupported_auto_mode", b""),
        "Failsafe activated": ("commander_failsafe_enter_generic", bytes((0, 0, 6, 0, 6))),
        "Orbit radius limit exceeded": ("orbit_radius_exceeded", b""),
        "Reposition is outside geofence": ("navigator_reposition_outside_geofence", b""),
        "Executing Mission": ("mission_execute", b""),
        "Mission finished, loitering": ("mission_finished_loiter", b""),
        "Pilot took over using sticks": ("commander_rc_override", b""),
        "Mission finished, landed": ("mission_finished", b""),
        "RTL: land at destination": ("rtl_land_at_destination", b""),
        "Connection to ground station lost": ("commander_gcs_lost", b""),
        "GCS connection regained": ("commander_dl_regained", b""),
        "Connection to mission computer lost": ("commander_mission_comp_lost", b""),
        "Operation timeout": ("mavlink_mission_op_timeout", b""),
        "Onboard controller regained": ("commander_onboard_ctrl_regained", b""),
    }
)
EVENT_TEXTS: Final[Mapping[str, str]] = MappingProxyType(
    {
        **{name: text for text, (name, _) in _NAMES.items()},
        "commander_armed_by": "Armed by {1}",
        "commander_disarmed_by": "Disarmed by {1}",
        "commander_failsafe_enter_generic": "Failsafe activated: switching to {2}",
        "commander_gcs_lost": "Connection to ground control station lost",
        "commander_landing_prec_land": "Landing using precision landing",
        "mavlink_mission_op_timeout": "Operation timeout, aborting transfer",
        "commander_mode_fallback_internal": "External mode is unresponsive, falling back to internal",
    }
)
"""Text of each event by its name; {1} is the first argument. Some differ from the text beside the event."""
FAILSAFE_ACTIONS: Final[Mapping[int, str]] = MappingProxyType(
    {
        1: "warning",
        2: "Position mode",
        3: "Altitude mode",
        4: "Stabilized mode",
        5: "Hold",
        6: "RTL",
        7: "Land",
        8: "Descend",
        9: "disarm",
        10: "terminate",
    }
)
"""Second argument of `commander_failsafe_enter_generic`."""
ARMING_REASONS: Final[Mapping[int, str]] = MappingProxyType(
    {
        _BY_COMMAND: "external command",
        _BY_MISSION: "mission start",
        _BY_LANDING: "landing",
        _BY_PREFLIGHT: "auto preflight disarming",
    }
)
"""First argument of `commander_armed_by` and `commander_disarmed_by`."""
_WITH_ARGUMENTS: Final = (
    *("RTL: ", "Climb to ", "Switching to ", "Failsafe activated", "Using default takeoff"),
    *("No valid mission", "Low battery", "Critical battery", "Emergency battery"),
    *("Arming denied: ", "SET_POSITION_TARGET_", "SET_ATTITUDE_TARGET"),
)
"""Beginnings of texts beside events that this table does not have."""


def with_tab(text: str) -> str:
    """Return a text as it is sent: PX4 ends it with a tab if an event says the same, so clients show only one."""
    is_event_too = text in _NAMES or text.startswith(_WITH_ARGUMENTS)
    return f"{text}\t" if is_event_too else text


def event_of(severity: int, text: str) -> Event | None:
    """Return the event of a text; None for texts without one."""
    event = _NAMES.get(text)
    if event is None:
        return None
    name, arguments = event
    levels = _WARNING_OF_INFO if text in _WARNINGS else _LEVELS.get(severity, 0x66)
    inside = _LEVELS_INSIDE.get(text, levels >> 4)
    levels = inside << 4 | levels & 0x0F
    return Event(event_id(name), levels, arguments.ljust(_ARGUMENTS, b"\0"))


def event_id(name: str) -> int:
    """Return the id of an event of the autopilot."""
    return _AUTOPILOT | fnv1a(name) & 0xFFFFFF


def fnv1a(text: str) -> int:
    """Return the 32-bit FNV-1a hash of a text, by which PX4 names events and external modes."""
    value = _FNV_SEED
    for byte in text.encode():
        value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
    return value
