"""Writes a first vehicle file: the bundled one with the limits of a running autopilot."""

import contextlib
import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from guidance.autopilots import Autopilot, autopilot_named
from guidance.clock import Clock, MonotonicClock
from guidance.config import config_folder, parse
from guidance.errors import ConfigError, OutputError
from guidance.links.opening import Found, open_link
from guidance.links.port import VehicleLink
from guidance.preflight import PreflightMemory
from guidance.session.discovery import autopilot_at
from guidance.session.vehicle_file import Config
from guidance.vehicle import VehicleState

READ_WITHIN_S: Final = 10.0
_LOOK_EVERY_S: Final = 0.02
_BEHIND_M: Final = 5.0
"""Distance of our fence from the autopilot's fence around it."""

_LIMITS_ABOVE: Final = 1.1
"""Default of the speed limits over the game's speeds."""


class Surveyed(NamedTuple):
    """An autopilot that answered, with the parameters that bound a vehicle file."""

    autopilot: str
    found: Found
    parameters: Mapping[str, float]


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
    with autopilot_at(url, asked, clock, who=url) as (wire, found, profile):
        link = open_link(
            wire,
            "pymavlink",
            system_id=found.system_id,
            component_id=found.component_id,
            clock=clock.now_s,
            who=f"{url}: system {found.system_id}",
        )
        with contextlib.closing(link):
            return Surveyed(profile.name, found, _read(link, profile, clock))


def _read(link: VehicleLink, profile: Autopilot, clock: Clock) -> Mapping[str, float]:
    """Request the parameters until all arrive or `READ_WITHIN_S` is over: an old firmware may lack one."""
    memory = PreflightMemory(sorted({bound.parameter for bound in profile.bounds}))
    begun_s = now_s = clock.now_s()
    link.send_heartbeat()
    while not memory.complete and now_s - begun_s < READ_WITHIN_S:
        memory.observe(link.receive(), ())
        for request in memory.requests(now_s):
            link.request(request)
        clock.sleep_until(now_s + _LOOK_EVERY_S)
        now_s = clock.now_s()
    return memory.facts(VehicleState(), now_s).parameters


def vehicle_file(autopilot: str, *, name: str, url: str | None = None, surveyed: Surveyed | None = None) -> str:
    """Return the text of a commented vehicle file, checked as in `guidance run`.

    Args:
        autopilot: Name of the autopilot.
        name: Name of the vehicle in orders, metrics and records.
        url: Its URL; None keeps the bundled one.
        surveyed: The limits that were read, if any.

    Raises:
        ConfigError: If the name, the URL or the autopilot is wrong.
    """
    described = autopilot_named(autopilot)
    templates = config_folder() / "vehicles"
    template = next(one for one in (templates / f"{autopilot}.toml", templates / "px4.toml") if one.is_file())
    text = template.read_text(encoding="utf-8")
    text = f"{_head(described, surveyed)}\n{text[text.index('name = ') :]}"
    text = _changed(text, "", "name", _quoted(name), "in orders, metrics and records")
    text = _changed(text, "vehicle", "autopilot", _quoted(autopilot))
    if url is not None:
        text = _changed(text, "vehicle", "url", _quoted(url))
    if surveyed is not None:
        text = _changed(text, "vehicle", "system_id", str(surveyed.found.system_id), "from its HEARTBEAT")
        for change in _bounded(tomllib.loads(text), surveyed):
            text = _changed(text, *change)
    parse(Config, tomllib.loads(text), source="the vehicle file")
    return text


def write_new(path: Path, text: str) -> None:
    """Write a new file.

    Raises:
        ConfigError: If it exists.
        OutputError: If it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError as error:
        raise ConfigError(f"--out {path}: exists and is not overwritten; choose another name") from error
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); choose another place") from error


def _head(autopilot: Autopilot, surveyed: Surveyed | None) -> str:
    head = (
        "# A vehicle file of pursuit guidance. Every key has its unit; `guidance schema vehicle` describes all keys.\n"
    )
    if surveyed is None:
        return f"{head}# Written without a vehicle: the limits are the bundled ones for {autopilot.name}.\n"
    head += f"# Read from system {surveyed.found.system_id}, {autopilot.name}:\n"
    for limit in autopilot.bounds:
        value = surveyed.parameters.get(limit.parameter)
        head += f"#   {limit.parameter:<18} {'not read' if value is None else f'{value:g}'}\n"
    return head


def _bounded(own: Mapping[str, Any], surveyed: Surveyed) -> Iterable[tuple[str, str, str, str]]:
    """Yield the keys whose bound was read, with the largest allowed value, at most the file's own."""
    for section, key, parameter, scale in autopilot_named(surveyed.autopilot).bounds:
        told = surveyed.parameters.get(parameter)
        if told is None:
            continue
        bound, value = told * scale, own[section][key]
        if section == "limits":
            value = value if bound <= _BEHIND_M else min(value, math.floor(bound - _BEHIND_M))
            said = f"{parameter} is {told:g}" + (", which is off: guidance check refuses it" if told == 0.0 else "")
        else:
            value = min(value, math.floor(10.0 * bound / _LIMITS_ABOVE) / 10.0)
            said = f"{parameter} is {told:g}"
        yield section, key, f"{value:.1f}", said
        if key == "ceiling_m" and value < own["flight"]["takeoff_height_m"]:
            yield "flight", "takeoff_height_m", f"{value:.1f}", "not above limits.ceiling_m"
            yield "game", "standoff_height_m", f"{value:.1f}", "not above limits.ceiling_m"
        if key == "speed_m_s" and value <= own["game"]["evader_speed_m_s"]:
            yield "game", "evader_speed_m_s", f"{value / 2.0:.2f}", "must be slower than the pursuer"


def _changed(text: str, section: str, key: str, value: str, why: str = "") -> str:
    """Replace the value of a key, and give the reason in a comment."""
    within = rf"^\[{section}\]\n(?:(?!\[).*\n)*?" if section else r"\A(?:(?!^\[).*\n)*?"
    comment = f"  # {why}" if why else r"\g<3>"
    line = rf"({within})^({key} = )[^#\n]*?( *#[^\n]*)?$"
    return re.sub(line, rf"\g<1>\g<2>{value}{comment}", text, count=1, flags=re.MULTILINE)


def _quoted(text: str) -> str:
    if re.search(r'["\\\x00-\x1f]', text):
        raise ConfigError(f"{text!r}: quotation marks, backslashes and control characters are not allowed")
    return f'"{text}"'
