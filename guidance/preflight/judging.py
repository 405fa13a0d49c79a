"""Judges the facts of an autopilot against the wants of a flight, as rows.

A fact that matters for safety and is unknown is refused. Before every engagement the needed parameters and the fence
are read and judged again (`engage_rows`).
"""

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from guidance import messages
from guidance.autopilots import Autopilot, Finding, Verdict, Wants, autopilots_of, description
from guidance.autopilots.description import type_name
from guidance.autopilots.rules import finding_of
from guidance.control.limits import farthest_evader_m
from guidance.frames import Amsl, LocalFrame, Projection
from guidance.messages import AutopilotVersion, EvaderReport, Heartbeat
from guidance.preflight import fence
from guidance.preflight.areas import contains
from guidance.preflight.fence import Uploaded
from guidance.preflight.parameters import quantities_read, rules_of, version_of
from guidance.preflight.reading import Facts

EVADER_ALTITUDE: Final = "evader's altitude"
"""Name of the row that says whether the evader is heard, and how high it is."""

_SILENT_S: Final = 3.0
"""After so long without its own HEARTBEAT the autopilot has become another one, or is gone."""

_AGREEMENT_M: Final = 5.0

_HOME_HEIGHT_M: Final = 3.0

_STREAMS: Final = (
    ("LOCAL_POSITION_NED", messages.LocalPosition, 10.0, Verdict.REFUSE, "the game"),
    ("ATTITUDE", messages.Attitude, 4.0, Verdict.REFUSE, "the heading"),
    ("GLOBAL_POSITION_INT", messages.GlobalPosition, 1.0, Verdict.WARN, "the frame check"),
    ("ODOMETRY", messages.Odometry, 5.0, Verdict.WARN, "the detection of estimator resets"),
    (
        "POSITION_TARGET_LOCAL_NED",
        messages.PositionTarget,
        1.0,
        Verdict.WARN,
        "the detection of foreign setpoints",
    ),
)
"""Name and type of each judged stream, its least rate, the verdict on a lower one, and its use."""


def rows(facts: Facts, autopilot: Autopilot, wants: Wants) -> tuple[Finding, ...]:
    """Judge everything. For a wrong autopilot, return that row only."""
    another = another_autopilot(facts, autopilot)
    if another is not None:
        return (another,)
    version = version_of(autopilot, facts.version)
    quantities = quantities_read(facts.parameters, version, facts.uploaded)
    wants = fence.about_home(wants, facts.vehicle, autopilot.projection)
    return (
        _version_row(facts.version, autopilot),
        *(
            finding_of(rule, facts.parameters, wants, quantities)
            for rule in rules_of(version, wants.announces)
        ),
        fence.uploaded_row(facts.uploaded, wants, facts.vehicle, autopilot, quantities),
        *_position_rows(facts, autopilot.projection, wants),
        *_stream_rows(facts, autopilot),
    )


def engage_rows(
    facts: Facts, autopilot: Autopilot, wants: Wants, *, unread_fence: str = ""
) -> tuple[Finding, ...]:
    """Judge the needed parameters and the uploaded fence as they were read again; an unknown one was not answered.

    Args:
        facts: The answers so far.
        autopilot: The vehicle's autopilot.
        wants: The configuration's demands.
        unread_fence: How far the fence was read again, if it was not read to its end.
    """
    version = version_of(autopilot, facts.version)
    uploaded = facts.uploaded
    if unread_fence:
        uploaded = Uploaded(problem=unread_fence)
    quantities = quantities_read(facts.parameters, version, uploaded)
    wants = fence.about_home(wants, facts.vehicle, autopilot.projection)
    rows = []
    for rule in rules_of(version, wants.announces):
        if rule.needed:
            row = finding_of(rule, facts.parameters, wants, quantities)
            if rule.name not in facts.parameters:
                row = row._replace(value="not answered", advice="check the link")
            rows.append(row)
    fence_row = fence.uploaded_row(uploaded, wants, facts.vehicle, autopilot, quantities)
    return (*rows, fence_row)


def another_autopilot(facts: Facts, autopilot: Autopilot) -> Finding | None:
    """Return the row that refuses an autopilot or vehicle type other than the configured one, or None.

    A HEARTBEAT of another program with the same ids is no reason to refuse as long as the autopilot's own arrive.
    """
    beat = facts.other_beat
    if beat is None:
        return None
    last_beat = facts.vehicle.latest.get(Heartbeat)
    if last_beat is not None and beat.received_s - last_beat.received_s <= _SILENT_S:
        return None
    matching = autopilots_of(beat.autopilot)
    name = "unknown"
    advice = (
        "another system's HEARTBEAT? check vehicle.url, vehicle.system_id and vehicle.component_id"
    )
    if matching:
        name = matching[0].name
        advice = f"a {type_name(beat.vehicle_type)} is not flown; check vehicle.url and vehicle.system_id"
    sender = next((candidate for candidate in matching if candidate.speaks(beat)), None)
    if sender is not None:
        name = sender.name
        advice = f'set vehicle.autopilot = "{name}", or check vehicle.url and vehicle.system_id'
    value = f"{name} (MAV_AUTOPILOT {beat.autopilot}), {type_name(beat.vehicle_type)}"
    expected = f"{autopilot.name} ({autopilot.autopilot_id}) in a vehicle that it may fly"
    return Finding("autopilot", value, expected, Verdict.REFUSE, advice)


def _version_row(firmware: AutopilotVersion | None, autopilot: Autopilot) -> Finding:
    """Judge the firmware's version: the names and units of parameters depend on it."""
    name = "autopilot version"
    oldest = autopilot.versions[0]
    newest = autopilot.versions[-1]
    expected = f"{oldest.words} to {newest.words}"
    if firmware is None:
        advice = "the names and units of parameters depend on it; requested again every few seconds"
        return Finding(name, "not read", expected, Verdict.REFUSE, advice)
    number = (firmware.major, firmware.minor)
    if number > newest.number:
        advice = f"newer than {newest.words}, the newest known one, as which it is judged"
        return Finding(name, firmware.words, expected, Verdict.WARN, advice)
    if number < oldest.number:
        advice = f"older than {oldest.words}, the oldest known one, as which it is judged"
        return Finding(name, firmware.words, expected, Verdict.WARN, advice)
    return Finding(name, firmware.words, expected, Verdict.PASS)


def _position_rows(facts: Facts, projection: Projection, wants: Wants) -> Iterator[Finding]:
    """Judge home in our fence, battery, origin, home, position and height datum.

    An old estimator origin or a wrong height datum has flown vehicles into the ground. Comparing two messages about
    the same place reveals both.
    """
    latest = facts.vehicle.latest
    corners = wants.limits.fence_polygon_ne_m
    if corners is not None:
        inside = bool(contains(corners, np.zeros((1, 2)))[0])
        value = "inside" if inside else "outside"
        yield Finding.of(inside, "home in our fence", value, "inside", "is this the right field?")
    if wants.battery_needed is not None:
        yield _battery(latest.get(messages.SystemStatus), wants.battery_needed)
    origin = latest.get(messages.Origin)
    home = latest.get(messages.Home)
    if origin is None or home is None:
        missing = []
        if origin is None:
            missing.append("GPS_GLOBAL_ORIGIN")
        if home is None:
            missing.append("HOME_POSITION")
        expected = f"{' and '.join(missing)} heard"
        yield Finding("local frame", "unknown", expected, Verdict.REFUSE, "wait for a position fix")
        return
    frame = LocalFrame(
        origin.latitude_deg,
        origin.longitude_deg,
        Amsl(origin.altitude_amsl_m),
        projection=projection,
    )
    # Home on the map against the origin, and against home in the local frame.
    altitude = Amsl(home.altitude_amsl_m)
    home_ned_m = frame.ned_from_wgs84(home.latitude_deg, home.longitude_deg, altitude)
    away_m = math.hypot(*home_ned_m[:2])
    advice = "restart the autopilot here: its origin is old"
    yield _limit_finding(
        "frame origin", away_m, wants.preflight.origin_distance_limit_m, "m from home", advice
    )
    apart_m = math.dist(home_ned_m, home.position_ned_m)
    advice = "home was set in another frame: set it again"
    yield _limit_finding("home in the frame", apart_m, _AGREEMENT_M, "m apart", advice)
    on_map = latest.get(messages.GlobalPosition)
    local = latest.get(messages.LocalPosition)
    if on_map is None or local is None:
        expected = "GLOBAL_POSITION_INT and LOCAL_POSITION_NED heard"
        advice = "wait for the estimator's position; check that both are streamed"
        yield Finding("position", "unknown", expected, Verdict.REFUSE, advice)
        return
    # The position on the map against the one in the local frame, and the heights above sea level and home.
    altitude = Amsl(on_map.altitude_amsl_m)
    on_map_ned_m = frame.ned_from_wgs84(on_map.latitude_deg, on_map.longitude_deg, altitude)
    apart_m = math.dist(on_map_ned_m, local.position_ned_m)
    advice = "LOCAL_POSITION_NED and GLOBAL_POSITION_INT contradict each other: restart the autopilot here"
    yield _limit_finding("local = global", apart_m, _AGREEMENT_M, "m apart", advice)
    difference_m = abs(on_map.altitude_amsl_m - on_map.altitude_above_home_m - home.altitude_amsl_m)
    advice = "the altitudes have different datums (sea level, ellipsoid, home?)"
    yield _limit_finding("datum of home", difference_m, _HOME_HEIGHT_M, "m apart", advice)
    yield from _evader_rows(facts.evader, home, frame, wants)
    if not facts.vehicle.armed:
        away_m = math.dist(local.position_ned_m[:2], home.position_ned_m[:2])
        at_home = away_m <= _AGREEMENT_M
        advice = "the fence will lie about home: set home here, unless you want it there"
        expected = f"at most {_AGREEMENT_M:g} m"
        value = f"{away_m:.1f} m from home"
        yield Finding.of(at_home, "vehicle at home", value, expected, advice, Verdict.WARN)


def _battery(status: messages.SystemStatus | None, needed: float) -> Finding:
    """Judge the charge against the configured reserve, which cannot act on an unknown charge."""
    name = "battery reserve"
    expected = f"at least {needed:.0%}, to fly home from the edge of the fence"
    if status is None or math.isnan(status.battery_remaining):
        advice = "the autopilot does not report the battery: set up its monitor, or remove flight.reserve"
        return Finding(name, "unknown", expected, Verdict.REFUSE, advice)
    charge = status.battery_remaining
    advice = "charge the battery or make the fence smaller; see flight.reserve"
    return Finding.of(charge >= needed, name, f"{charge:.0%}", expected, advice)


def _evader_rows(
    evader: EvaderReport | None, home: messages.Home, frame: LocalFrame, wants: Wants
) -> Iterator[Finding]:
    """Judge the evader's altitude, and whether it can be met inside our fence."""
    name = EVADER_ALTITUDE
    limit_m = wants.evader_height_limit_m
    if evader is None:
        expected = f"within {limit_m:g} m of home"
        yield Finding(name, "not heard", expected, Verdict.WARN, "is it sending?")
        return
    difference_m = abs(evader.altitude_amsl_m - home.altitude_amsl_m)
    advice = (
        "a different datum? The geoid is about 50 m above the ellipsoid: see evader.altitude_datum"
    )
    yield _limit_finding(name, difference_m, limit_m, "m from home's", advice)
    altitude = Amsl(home.altitude_amsl_m)
    evader_ned_m = frame.ned_from_wgs84(evader.latitude_deg, evader.longitude_deg, altitude)
    home_ned_m = frame.ned_from_wgs84(home.latitude_deg, home.longitude_deg, altitude)
    away_m = math.dist(evader_ned_m[:2], home_ned_m[:2])
    farthest_m = farthest_evader_m(
        wants.limits.reach_m,
        evader_speed_m_s=wants.evader_speed_m_s,
        speed_m_s=wants.game_speeds.speed_m_s,
        standoff_radius_m=wants.standoff_radius_m,
    )
    expected = f"at most {farthest_m:.0f} m, from where it can be met inside our fence"
    advice = "is it the right evader, and has it a position fix?"
    value = f"{away_m:.0f} m from home"
    yield Finding.of(away_m <= farthest_m, "evader's distance", value, expected, advice)


def _limit_finding(name: str, value_m: float, limit_m: float, words: str, advice: str) -> Finding:
    value = f"{value_m:.1f} {words}"
    return Finding.of(value_m <= limit_m, name, value, f"at most {limit_m:g} m", advice)


def _stream_rows(facts: Facts, autopilot: Autopilot) -> Iterator[Finding]:
    """Judge the rate of every requested stream."""
    for name, kind, least_hz, otherwise, reader in _STREAMS:
        requested_hz = autopilot.streams_hz.get(getattr(description, name))
        # ArduCopter reports its setpoint in GUIDED only.
        guided_only = kind is messages.PositionTarget and not autopilot.tells_setpoint_always
        if requested_hz is None or guided_only:
            continue
        rate_hz = facts.rates_hz.get(kind, 0.0)
        value = f"{rate_hz:.1f} Hz"
        expected = f"at least {least_hz:g} Hz ({requested_hz:g} requested)"
        advice = f"{reader} needs it: is the link fast enough for {requested_hz:g} Hz?"
        yield Finding.of(rate_hz >= least_hz, name, value, expected, advice, otherwise)


def refusals(rows: Sequence[Finding]) -> tuple[str, ...]:
    """Return the names of the refused rows."""
    return tuple(row.name for row in rows if row.verdict is Verdict.REFUSE)


def advice(rows: Sequence[Finding]) -> str:
    """Return one line with every refused row and its fix."""
    refused = (row for row in rows if row.verdict is Verdict.REFUSE)
    return "; ".join(
        f"{row.name} is {row.value}, expected {row.wanted} ({row.advice})" for row in refused
    )
