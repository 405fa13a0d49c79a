"""Preflight: is the autopilot set up for offboard flight? Judges parameters, frames and rates as rows.

`PreflightMemory` requests parameters (`parameter_names`) and collects `Facts`. `rows` judges them against the wants of
a flight; each row is a `guidance.autopilots.Finding`. `changes` are the parameters to set so that no row is refused.
Before every engagement the needed parameters are read and judged again (`engage_rows`).
"""

import math
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from guidance import messages
from guidance.autopilots import Autopilot, Finding, Verdict, Wants, autopilots_of, description
from guidance.autopilots.description import type_name
from guidance.autopilots.rules import UPLOADED, Judgement, row_of
from guidance.control.polygon import Polygon
from guidance.frames import Amsl, LocalFrame, Projection
from guidance.messages import (
    EvaderReport,
    Heartbeat,
    Message,
    Parameter,
    ParameterRequest,
    ParameterSet,
    Request,
)
from guidance.preflight import fence
from guidance.preflight.fence import Reading, Uploaded
from guidance.vehicle import VehicleState

ASK_AGAIN_S: Final = 5.0
"""Period of new requests. The link itself repeats each request four times within two seconds."""

COUNTED_S: Final = 2.0
"""Averaging time of rates."""


class Facts(NamedTuple):
    """Facts about one vehicle.

    Attributes:
        parameters: Parameters that were read.
        parameter_types: Their MAV_PARAM_TYPE.
        vehicle: State from telemetry.
        rates_hz: Rate of each kind of message.
        evader_amsl_m: The evader's last altitude.
        uploaded: The uploaded fence.
        other_beat: The last HEARTBEAT with the vehicle's ids that is not the configured autopilot's.
    """

    parameters: Mapping[str, float] = MappingProxyType({})
    parameter_types: Mapping[str, int] = MappingProxyType({})
    vehicle: VehicleState = VehicleState()
    rates_hz: Mapping[type[Message], float] = MappingProxyType({})
    evader_amsl_m: float | None = None
    uploaded: Uploaded = Uploaded()
    other_beat: Heartbeat | None = None


class PreflightMemory:
    """Collects the facts of one vehicle."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = dict.fromkeys(names)
        self._parameters: dict[str, Parameter] = {}
        self._arrivals: dict[type[Message], deque[float]] = {}
        self._asked_s = -math.inf
        self._evader_amsl_m: float | None = None
        self._fence = Reading()

    def observe(self, messages: Iterable[Message], reports: Iterable[EvaderReport]) -> None:
        """Handle the messages of one cycle. Autopilots announce changed parameters, so the facts stay current."""
        for message in messages:
            self._arrivals.setdefault(type(message), deque(maxlen=512)).append(message.received_s)
            self._fence.observe(message)
            if isinstance(message, Parameter) and message.name in self._names:
                self._parameters[message.name] = message
        for report in reports:
            self._evader_amsl_m = report.altitude_amsl_m

    def requests(self, now_s: float) -> tuple[Request, ...]:
        """Request missing parameters every `ASK_AGAIN_S`, then the uploaded fence."""
        if Heartbeat not in self._arrivals:
            return ()
        if self.complete:
            return self._fence.requests(now_s)
        if now_s - self._asked_s < ASK_AGAIN_S:
            return ()
        self._asked_s = now_s
        return tuple(ParameterRequest(name) for name in self._names if name not in self._parameters)

    def forget(self, names: Iterable[str]) -> None:
        """Forget these parameters and request them again."""
        for name in names:
            self._parameters.pop(name, None)
        self._asked_s = -math.inf

    @property
    def complete(self) -> bool:
        """Whether every parameter was read. The uploaded fence is optional."""
        return self._parameters.keys() == self._names.keys()

    @property
    def read(self) -> tuple[int, int]:
        """Number of parameters read, and of parameters requested."""
        return len(self._parameters), len(self._names)

    def facts(
        self, vehicle: VehicleState, now_s: float, other_beat: Heartbeat | None = None
    ) -> Facts:
        """Return the facts at `now_s`; `other_beat` is a HEARTBEAT that the flight did not accept."""
        arrivals = self._arrivals.items()
        rates_hz = {
            kind: sum(now_s - at_s <= COUNTED_S for at_s in times_s) / COUNTED_S
            for kind, times_s in arrivals
        }
        values = {name: one.value for name, one in self._parameters.items()}
        types = {
            name: one.param_type
            for name, one in self._parameters.items()
            if one.param_type is not None
        }
        return Facts(
            values, types, vehicle, rates_hz, self._evader_amsl_m, self._fence.found, other_beat
        )


_SILENT_S: Final = 3.0
"""After so long without its own HEARTBEAT the autopilot has become another one, or is gone."""

_MOST_ROUNDS: Final = 4
_REAL32: Final = 9
_AGREEMENT_M: Final = 5.0
_HOME_HEIGHT_M: Final = 3.0


class ParameterChange(NamedTuple):
    """A parameter to set: formatted values before and after, the reason, and the verdict on the present value."""

    name: str
    now: str
    then: str
    why: str
    verdict: Verdict
    request: ParameterSet


def parameter_names(autopilot: Autopilot, *, only_needed: bool = False) -> tuple[str, ...]:
    """Return the names of the judged parameters. Those that are needed are read again before every engagement."""
    return tuple(rule.name for rule in autopilot.rules if rule.needed or not only_needed)


def rows(facts: Facts, autopilot: Autopilot, wants: Wants) -> tuple[Finding, ...]:
    """Judge everything. For a wrong autopilot, return that row only."""
    if (other := another_autopilot(facts, autopilot)) is not None:
        return (other,)
    parameters = _judged(facts)
    wants = fence.about_home(wants, facts.vehicle, autopilot.projection)
    return (
        *(row_of(rule, parameters, wants) for rule in autopilot.rules),
        fence.uploaded_row(facts.uploaded, wants, facts.vehicle, autopilot, parameters),
        *_position_rows(facts, autopilot.projection, wants),
        *_stream_rows(facts, autopilot),
    )


def _position_rows(facts: Facts, projection: Projection, wants: Wants) -> Iterator[Finding]:
    """Judge home in our fence, battery, origin, home, position and height datum.

    An old estimator origin or a wrong height datum has flown vehicles into the ground. Comparing two messages about
    the same place reveals both.
    """
    vehicle = facts.vehicle
    corners = wants.limits.fence_polygon_ne_m
    if corners is not None:
        inside = Polygon(corners).contains((0.0, 0.0))
        found = "inside" if inside else "outside"
        yield Finding.of(inside, "home in our fence", found, "inside", "is this the right field?")
    if wants.battery_needed is not None:
        yield _battery(vehicle.latest.get(messages.SystemStatus), wants.battery_needed)
    origin = vehicle.latest.get(messages.Origin)
    home = vehicle.latest.get(messages.Home)
    if origin is None or home is None:
        names = ("GPS_GLOBAL_ORIGIN", origin), ("HOME_POSITION", home)
        missing = " and ".join(name for name, message in names if message is None)
        yield Finding(
            "local frame", "unknown", f"{missing} heard", Verdict.REFUSE, "wait for a position fix"
        )
        return
    home_amsl_m = home.altitude_amsl_m
    zero = (
        origin.latitude_deg,
        origin.longitude_deg,
        Amsl(origin.altitude_amsl_m),
        Amsl(home_amsl_m),
    )
    frame = LocalFrame(*zero, projection=projection)
    home_ned_m = frame.ned_from_wgs84(home.latitude_deg, home.longitude_deg, Amsl(home_amsl_m))
    away_m = math.hypot(*home_ned_m[:2])
    limit_m = wants.preflight.origin_distance_limit_m
    yield _within(
        "frame origin",
        away_m,
        limit_m,
        "m from home",
        "restart the autopilot here: its origin is old",
    )
    apart_m = math.dist(home_ned_m, home.position_ned_m)
    advice = "home was set in another frame: set it again"
    yield _within("home in the frame", apart_m, _AGREEMENT_M, "m apart", advice)
    place = vehicle.latest.get(messages.GlobalPosition)
    local = vehicle.latest.get(messages.LocalPosition)
    if place is None or local is None:
        yield Finding(
            "position",
            "unknown",
            "GLOBAL_POSITION_INT and LOCAL_POSITION_NED heard",
            Verdict.REFUSE,
        )
        return
    reckoned_m = frame.ned_from_wgs84(
        place.latitude_deg, place.longitude_deg, Amsl(place.altitude_amsl_m)
    )
    apart_m = math.dist(reckoned_m, local.position_ned_m)
    advice = "LOCAL_POSITION_NED and GLOBAL_POSITION_INT contradict each other: restart the autopilot here"
    yield _within("local = global", apart_m, _AGREEMENT_M, "m apart", advice)
    difference_m = abs(place.altitude_amsl_m - place.altitude_above_home_m - home_amsl_m)
    advice = "the altitudes have different datums (sea level, ellipsoid, home?)"
    yield _within("datum of home", difference_m, _HOME_HEIGHT_M, "m apart", advice)
    limit_m = wants.preflight.evader_height_limit_m
    evader_amsl_m = facts.evader_amsl_m
    if evader_amsl_m is None:
        yield Finding(
            "evader's altitude",
            "not heard",
            f"within {limit_m:g} m of home",
            Verdict.WARN,
            "is it sending?",
        )
        return
    advice = "a different datum? The geoid is about 50 m above the ellipsoid: see evader.frame.undulation_m"
    yield _within(
        "evader's altitude", abs(evader_amsl_m - home_amsl_m), limit_m, "m from home's", advice
    )


def _battery(status: messages.SystemStatus | None, needed: float) -> Finding:
    wanted = f"at least {needed:.0%}, to fly home from the edge of the fence"
    if status is None or math.isnan(status.battery_remaining):
        return Finding(
            "battery reserve",
            "unknown",
            wanted,
            Verdict.WARN,
            "the autopilot does not report the battery",
        )
    left = status.battery_remaining
    advice = "charge the battery or make the fence smaller; see flight.reserve"
    return Finding.of(left >= needed, "battery reserve", f"{left:.0%}", wanted, advice)


def _within(name: str, found: float, limit: float, what: str, advice: str) -> Finding:
    return Finding.of(found <= limit, name, f"{found:.1f} {what}", f"at most {limit:g} m", advice)


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
"""Name and type of each judged stream, its least rate, the verdict on a lower one, and what needs it."""


def _stream_rows(facts: Facts, autopilot: Autopilot) -> Iterator[Finding]:
    """Judge the rate of every requested stream."""
    for name, kind, least_hz, otherwise, reader in _STREAMS:
        asked_hz = autopilot.streams_hz.get(getattr(description, name))
        # ArduCopter reports its setpoint in GUIDED only.
        if asked_hz is None or (
            kind is messages.PositionTarget and not autopilot.tells_setpoint_always
        ):
            continue
        rate_hz = facts.rates_hz.get(kind, 0.0)
        wanted = f"at least {least_hz:g} Hz ({asked_hz:g} requested)"
        advice = f"{reader} needs it: is the link fast enough for {asked_hz:g} Hz?"
        yield Finding.of(rate_hz >= least_hz, name, f"{rate_hz:.1f} Hz", wanted, advice, otherwise)


def engage_rows(facts: Facts, autopilot: Autopilot, wants: Wants) -> tuple[Finding, ...]:
    """Judge the needed parameters; an unknown one has not been answered."""
    parameters = _judged(facts)
    wants = fence.about_home(wants, facts.vehicle, autopilot.projection)
    return tuple(
        row
        if row.name in parameters
        else row._replace(value="not answered", advice="check the link")
        for row in (row_of(rule, parameters, wants) for rule in autopilot.rules if rule.needed)
    )


def another_autopilot(facts: Facts, autopilot: Autopilot) -> Finding | None:
    """Return the row that refuses an autopilot or vehicle type other than the configured one, or None.

    A HEARTBEAT of another program with the same ids is no reason to refuse as long as the autopilot's own arrive.
    """
    other = facts.other_beat
    if other is None:
        return None
    own = facts.vehicle.latest.get(Heartbeat)
    if own is not None and other.received_s - own.received_s <= _SILENT_S:
        return None
    matching = autopilots_of(other.autopilot)
    name = "unknown"
    advice = (
        "another system's HEARTBEAT? check vehicle.url, vehicle.system_id and vehicle.component_id"
    )
    if matching:
        name = matching[0].name
        advice = f"a {type_name(other.vehicle_type)} is not flown; check vehicle.url and vehicle.system_id"
    flown = next((known for known in matching if known.speaks(other)), None)
    if flown is not None:
        name = flown.name
        advice = (
            f'set vehicle.autopilot = "{flown.name}", or check vehicle.url and vehicle.system_id'
        )
    value = f"{name} (MAV_AUTOPILOT {other.autopilot}), {type_name(other.vehicle_type)}"
    wanted = f"{autopilot.name} ({autopilot.autopilot_id}) in a vehicle that it may fly"
    return Finding("autopilot", value, wanted, Verdict.REFUSE, advice)


def changes(
    facts: Facts, autopilot: Autopilot, wants: Wants, *, advised: bool = False
) -> tuple[ParameterChange, ...]:
    """Return the parameters to set so that none is refused any more, where a rule has a value to set.

    One change can require another (a return height below a fence that was off), so the rules are applied repeatedly.

    Args:
        facts: What was read.
        autopilot: The vehicle's autopilot.
        wants: What the configuration demands.
        advised: Whether to change parameters with a warning, too.
    """
    before = _judged(facts)
    wants = fence.about_home(wants, facts.vehicle, autopilot.projection)
    after = dict(before)
    wrong = dict[str, Judgement]()
    fit = {Verdict.PASS} if advised else {Verdict.PASS, Verdict.WARN}
    rules = [rule for rule in autopilot.rules if rule.name in before]
    for _ in range(_MOST_ROUNDS):
        found = {rule.name: rule.judge(after[rule.name], wants, after) for rule in rules}
        mended = {
            name: one
            for name, one in found.items()
            if one.verdict not in fit and one.set_to is not None
        }
        wrong = mended | wrong
        after |= {
            name: single(one.set_to) for name, one in mended.items() if one.set_to is not None
        }
    changed = []
    for rule in rules:
        name = rule.name
        now = before[rule.name]
        then = after[rule.name]
        if then != now:
            why = "; ".join(filter(None, (wrong[name].wanted, wrong[name].why)))
            request = ParameterSet(name, then, facts.parameter_types.get(name, _REAL32))
            changed.append(
                ParameterChange(
                    name, rule.read(now), rule.read(then), why, wrong[name].verdict, request
                )
            )
    return tuple(changed)


def _judged(facts: Facts) -> dict[str, float]:
    areas = facts.uploaded.areas
    told = {} if areas is None else {UPLOADED: float(any(area.inclusion for area in areas))}
    return {**facts.parameters, **told}


def refusals(rows: Sequence[Finding]) -> tuple[str, ...]:
    """Return the names of the refused rows."""
    return tuple(row.name for row in rows if row.verdict is Verdict.REFUSE)


def advice(rows: Sequence[Finding]) -> str:
    """Return one line with every refused row and its fix."""
    refused = (row for row in rows if row.verdict is Verdict.REFUSE)
    return "; ".join(
        f"{row.name} is {row.value}, expected {row.wanted} ({row.advice})" for row in refused
    )


def single(value: float) -> float:
    """Round to single precision, as parameters have on the wire."""
    return float(np.float32(value))
