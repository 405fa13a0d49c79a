"""PX4's component metadata: files that tell a client what the autopilot's parameters and events mean.

COMPONENT_METADATA names the general file, which names the others; all are JSON, compressed, below ``/etc/extras`` as in
PX4 v1.17. Formats: MAVLink's component metadata protocol, and libevents for events. With them MAVSDK and QGroundControl
show events and the report of arming checks in words.
"""

from __future__ import annotations

import json
import lzma
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.protocols import file_crc
from sitl_mock.px4.arming_report import CHECK_TEXTS
from sitl_mock.px4.events import ARMING_REASONS, EVENT_TEXTS, FAILSAFE_ACTIONS, fnv1a
from sitl_mock.px4.modes import BY_NAME, NAV_STATES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from sitl_mock.protocols import Parameter, ParameterStore

GENERAL: Final = "etc/extras/component_general.json.xz"
_PARAMETERS: Final = "etc/extras/parameters.json.xz"
_EVENTS: Final = "etc/extras/all_events.json.xz"
_PARAMETER_TYPE: Final = 1  # COMP_METADATA_TYPE
_EVENTS_TYPE: Final = 4
_TYPES: Final = {6: "Int32", 9: "Float"}
_MODE_NAMES: Final = {"HOLD": "loiter", "STABILIZED": "stab", "FOLLOW": "follow_target"}
"""Names in PX4's metadata that differ from those of the mock's modes."""
_COMPONENTS: Final = (
    *("none", "absolute_pressure", "differential_pressure", "gps", "optical_flow"),
    *("vision_position", "distance_sensor", "remote_control", "motors_escs", "utm", "logging"),
    *("battery", "communication_links", "rate_controller", "attitude_controller"),
    *("position_controller", "attitude_estimate", "local_position_estimate", "mission"),
    *("avoidance", "system", "camera", "gimbal", "payload", "global_position_estimate"),
    *("storage", "parachute", "magnetometer", "accel", "gyro", "open_drone_id"),
)
"""Parts that a report of health or of arming checks names, by the number of their bit."""


def metadata_files(parameters: ParameterStore) -> dict[str, Callable[[], bytes]]:
    """Return the files by their path, made when they are read."""
    listed = tuple(parameters.definitions.values())
    return {
        f"/{GENERAL}": lambda: _general(listed),
        f"/{_PARAMETERS}": lambda: _parameters(listed),
        f"/{_EVENTS}": _events,
    }


def general_crc(parameters: ParameterStore) -> int:
    """Return MAVLink's CRC-32 of the general file."""
    return file_crc(_general(tuple(parameters.definitions.values())))


@cache
def _general(listed: tuple[Parameter, ...]) -> bytes:
    """COMP_METADATA_TYPE_GENERAL: where the other files are."""
    contents = (
        (_PARAMETER_TYPE, _PARAMETERS, _parameters(listed)),
        (_EVENTS_TYPE, _EVENTS, _events()),
    )
    types = [
        {"type": kind, "uri": f"mftp://{path}", "fileCrc": file_crc(content)}
        for kind, path, content in contents
    ]
    return _compressed({"version": 1, "metadataTypes": types})


@cache
def _parameters(listed: tuple[Parameter, ...]) -> bytes:
    """COMP_METADATA_TYPE_PARAMETER: name, type, default, unit and limits of each parameter."""
    described = []
    for item in listed:
        entry = {
            "name": item.name,
            "type": _TYPES[item.kind],
            "default": item.default,
            "shortDesc": item.meaning,
        }
        if item.unit:
            entry["units"] = item.unit
        if item.minimum > float("-inf"):
            entry |= {"min": item.minimum, "max": item.maximum}
        described.append(entry)
    return _compressed({"version": 1, "parameters": described})


@cache
def _events() -> bytes:
    """COMP_METADATA_TYPE_EVENTS: the text and the arguments of each event that the mock sends."""
    reason = {"type": "arm_disarm_reason_t", "name": "reason"}
    action = (
        {"type": "uint32_t", "name": "arg0"},
        {"type": "failsafe_action_t", "name": "action"},
    )
    arguments = {
        "commander_armed_by": (reason,),
        "commander_disarmed_by": (reason,),
        "commander_failsafe_enter_generic": action,
    }
    events = [
        _event(name, text, arguments=arguments.get(name, ())) for name, text in EVENT_TEXTS.items()
    ]
    modes = {"type": "navigation_mode_group_t", "name": "modes"}
    component = {"type": "uint8_t", "name": "health_component_index"}
    chunk = {"type": "uint8_t", "name": "chunk_idx"}
    checks = [
        _event(
            "commander_arming_check_summary",
            "",
            kind="summary",
            arguments=(
                chunk,
                *({"type": "health_component_t", "name": name} for name in ("error", "warning")),
                *({**modes, "name": name} for name in ("can_arm", "can_run")),
            ),
        )
    ]
    checks += [
        _event(name, text, arguments=(modes, component)) for name, text in CHECK_TEXTS.items()
    ]
    parts = ("is_present", "error", "warning")
    health = _event(
        "commander_health_summary",
        "",
        kind="summary",
        arguments=(chunk, *({"type": "health_component_t", "name": name} for name in parts)),
    )
    named = {name: _MODE_NAMES.get(name, name.lower()) for name in NAV_STATES}
    enums = {
        "navigation_mode_group_t": _bits(
            (NAV_STATES[mode][0], name, NAV_STATES[mode][1]) for mode, name in named.items()
        ),
        "health_component_t": _bits(
            (number, name, name.replace("_", " ").capitalize())
            for number, name in enumerate(_COMPONENTS)
        ),
        "arm_disarm_reason_t": _numbers(ARMING_REASONS),
        "failsafe_action_t": _numbers(FAILSAFE_ACTIONS),
    }
    px4 = {
        "namespace": "px4",
        "enums": enums,
        "event_groups": {
            "default": {"events": dict(events)},
            "arming_check": {"events": dict(checks)},
            "health": {"events": dict([health])},
        },
        "navigation_mode_groups": {
            "groups": {
                str(number): [BY_NAME[mode].number]
                for mode, (number, _) in NAV_STATES.items()
                if mode in BY_NAME
            }
        },
        "supported_protocols": ["health_and_arming_check"],
    }
    return _compressed({"version": 2, "components": {"1": px4}})


def _event(
    name: str, text: str, *, kind: str = "", arguments: Iterable[Mapping[str, str]] = ()
) -> tuple[str, dict[str, Any]]:
    """Return the number of an event within its component, and its description."""
    described: dict[str, Any] = {"name": name, "message": text, "arguments": list(arguments)}
    if kind:
        described["type"] = kind
    return str(fnv1a(name) & 0xFFFFFF), described


def _numbers(words: Mapping[int, str]) -> dict[str, Any]:
    """Return what the values of a byte mean."""
    entries = {
        str(number): {"name": text.replace(" ", "_"), "description": text}
        for number, text in words.items()
    }
    return {"type": "uint8_t", "entries": entries}


def _bits(named: Iterable[tuple[int, str, str]]) -> dict[str, Any]:
    """Return a set of bits: number, name and description of each."""
    entries = {
        str(1 << number): {"name": name, "description": description}
        for number, name, description in named
    }
    return {"type": "uint32_t", "is_bitfield": True, "entries": entries}


def _compressed(document: Mapping[str, Any]) -> bytes:
    return lzma.compress(json.dumps(document).encode())
