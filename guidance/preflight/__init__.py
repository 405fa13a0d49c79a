"""Preflight: is the autopilot set up for offboard flight? Judges parameters, frames and rates as rows.

`PreflightMemory` asks for the firmware's version, for the parameters that this version has (`parameter_names`) and for
the uploaded fence, and collects `Facts`. `rows` judges them against the wants of a flight; each row is a
`guidance.autopilots.Finding`. What matters for safety and is unknown is refused. `changes` are the parameters to set so
that no row is refused. Before every engagement the needed parameters and the fence are read and judged again
(`engage_rows`).
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from guidance import messages
from guidance.autopilots import (
    Autopilot,
    Finding,
    Verdict,
    Version,
    Wants,
    autopilots_of,
    description,
)
from guidance.autopilots.description import AUTOPILOT_VERSION, type_name
from guidance.autopilots.rules import Judgement, Quantity, Rule, finding_of
from guidance.control.limits import farthest_evader_m
from guidance.control.polygon import Point
from guidance.flight.freshness import known
from guidance.frames import Amsl, LocalFrame, Projection
from guidance.messages import (
    AutopilotVersion,
    EvaderReport,
    Heartbeat,
    Message,
    Parameter,
    ParameterRequest,
    ParameterSet,
    Request,
)
from guidance.preflight import fence
from guidance.preflight.areas import contains
from guidance.preflight.fence import Reading, Uploaded
from guidance.vehicle import VehicleState

ASK_AGAIN_S: Final = 5.0
"""Period of new requests. The link itself repeats each request four times within two seconds."""

COUNTED_S: Final = 2.0
"""Averaging time of rates."""

EVADER_HEARD_S: Final = 5.0
"""A report of the evader that is older is not judged."""


class Facts(NamedTuple):
    """Facts about one vehicle.

    Attributes:
        parameters: Parameters that were read.
        parameter_types: Their MAV_PARAM_TYPE.
        vehicle: State from telemetry.
        rates_hz: Rate of each kind of message.
        evader: The evader's last report, if it is not old.
        uploaded: The uploaded fence.
        other_beat: The last HEARTBEAT with the vehicle's ids that is not the configured autopilot's.
        version: The firmware's version.
    """

    parameters: Mapping[str, float] = MappingProxyType({})
    parameter_types: Mapping[str, int] = MappingProxyType({})
    vehicle: VehicleState = VehicleState()
    rates_hz: Mapping[type[Message], float] = MappingProxyType({})
    evader: EvaderReport | None = None
    uploaded: Uploaded = Uploaded()
    other_beat: Heartbeat | None = None
    version: AutopilotVersion | None = None


class PreflightMemory:
    """Collects the facts of one vehicle.

    Args:
        autopilot: The configured autopilot.
        names: Returns the parameters to read in a version of it.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        names: Callable[[Version], Sequence[str]] | None = None,
    ) -> None:
        self._autopilot = autopilot
        self._names_of = parameter_names if names is None else names
        self._heard_version: AutopilotVersion | None = None
        self._parameters: dict[str, Parameter] = {}
        self._arrivals: dict[type[Message], deque[float]] = {}
        self._begun_s: float | None = None
        self._asked_s = -math.inf
        self._evader: EvaderReport | None = None
        self._fence = Reading()
        self._names = self._named()

    def _named(self) -> dict[str, None]:
        return dict.fromkeys(self._names_of(self.version))

    @property
    def version(self) -> Version:
        """The description of the firmware's version; until it is known, of the oldest one."""
        return _version_of(self._autopilot, self._heard_version)

    def observe(self, messages: Iterable[Message], reports: Iterable[EvaderReport]) -> None:
        """Handle the messages of one cycle. Autopilots announce changed parameters, so the facts stay current."""
        for message in messages:
            if isinstance(message, Heartbeat) and not self._autopilot.speaks(message):
                continue
            self._arrivals.setdefault(type(message), deque(maxlen=512)).append(message.received_s)
            self._fence.observe(message)
            if isinstance(message, Parameter):
                self._take_parameter(message)
            elif isinstance(message, AutopilotVersion):
                self._heard_version = message
                self._names = self._named()
                self._asked_s = -math.inf
        for report in reports:
            self._evader = report

    def _take_parameter(self, parameter: Parameter) -> None:
        if parameter.name in self._names:
            self._parameters[parameter.name] = parameter

    def requests(self, now_s: float) -> tuple[Request, ...]:
        """Request the fence, the version and missing parameters, the last two every `ASK_AGAIN_S`.

        The parameters' names depend on the version, so the version is requested first.
        """
        if Heartbeat not in self._arrivals:
            return ()
        if self._begun_s is None:
            self._begun_s = now_s
        requests: list[Request] = [*self._fence.requests(now_s)]
        if now_s - self._asked_s < ASK_AGAIN_S or self.complete:
            return tuple(requests)
        self._asked_s = now_s
        if self._heard_version is None:
            requests.append(self._autopilot.request_message(AUTOPILOT_VERSION))
            if now_s - self._begun_s < ASK_AGAIN_S:
                return tuple(requests)
        requests += [ParameterRequest(name) for name in self._names if name not in self._parameters]
        return tuple(requests)

    def read_again(self, names: Iterable[str]) -> None:
        """Forget these parameters, and request them again."""
        for name in names:
            self._parameters.pop(name, None)
        self._asked_s = -math.inf

    def read_fence_again(self) -> None:
        """Read the uploaded fence from the beginning, because it may have been replaced."""
        self._fence.begin()

    def fence_read_since(self, moment_s: float) -> bool:
        """Return whether the uploaded fence was read in a download that began at `moment_s` or later."""
        return self._fence.found_begun_s >= moment_s

    @property
    def reading_fence(self) -> bool:
        """Whether a download of the uploaded fence is under way."""
        return not self._fence.over

    @property
    def fence_progress(self) -> str:
        """How far the download of the uploaded fence is, in words."""
        return self._fence.progress

    @property
    def fence_known(self) -> bool:
        """Whether the uploaded fence was read once, or refused."""
        return self._fence.found != Uploaded()

    @property
    def complete(self) -> bool:
        """Whether the version and every parameter were read. The uploaded fence is read apart from them."""
        return self._heard_version is not None and self.parameters_complete

    @property
    def parameters_complete(self) -> bool:
        """Whether every parameter was read."""
        return all(name in self._parameters for name in self._names)

    def settled(self, now_s: float) -> bool:
        """Whether reading is finished: everything is here, or the requests have waited too long for it."""
        if self._begun_s is None:
            return False
        if self.complete and self.fence_known:
            return True
        return now_s - self._begun_s > 2.0 * ASK_AGAIN_S

    @property
    def missing(self) -> tuple[str, ...]:
        """What was not read yet, in words."""
        missing = []
        if self._heard_version is None:
            missing.append("AUTOPILOT_VERSION")
        unread = sum(name not in self._parameters for name in self._names)
        if unread:
            missing.append(f"{unread} of {len(self._names)} parameters")
        if not self.fence_known:
            missing.append("uploaded fence")
        return tuple(missing)

    def facts(
        self, vehicle: VehicleState, now_s: float, other_beat: Heartbeat | None = None
    ) -> Facts:
        """Return the facts at `now_s`, without telemetry that is too old to judge by.

        Args:
            vehicle: State from telemetry.
            now_s: The present.
            other_beat: A HEARTBEAT that the flight did not accept.
        """
        rates_hz = {}
        for kind, times_s in self._arrivals.items():
            arrivals = sum(now_s - at_s <= COUNTED_S for at_s in times_s)
            rates_hz[kind] = arrivals / COUNTED_S
        evader = self._evader
        if evader is not None and now_s - evader.received_s > EVADER_HEARD_S:
            evader = None
        read = self._parameters.items()
        return Facts(
            parameters={name: parameter.value for name, parameter in read},
            parameter_types={
                name: parameter.param_type
                for name, parameter in read
                if parameter.param_type is not None
            },
            vehicle=known(vehicle, now_s),
            rates_hz=rates_hz,
            evader=evader,
            uploaded=self._fence.found,
            other_beat=other_beat,
            version=self._heard_version,
        )


def _version_of(autopilot: Autopilot, firmware: AutopilotVersion | None) -> Version:
    if firmware is None:
        return autopilot.version_of(None)
    return autopilot.version_of((firmware.major, firmware.minor))


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


def parameter_names(
    version: Version, *, announces: bool = False, only_needed: bool = False
) -> tuple[str, ...]:
    """Return the names of the judged parameters.

    Args:
        version: Of the autopilot.
        announces: Whether the evader is announced as traffic.
        only_needed: Only those that are needed, which are read again before every engagement.
    """
    rules = _rules_of(version, announces)
    return tuple(rule.name for rule in rules if rule.needed or not only_needed)


def _rules_of(version: Version, announces: bool) -> tuple[Rule, ...]:
    return tuple(rule for rule in version.rules if announces or not rule.of_announced)


def rows(facts: Facts, autopilot: Autopilot, wants: Wants) -> tuple[Finding, ...]:
    """Judge everything. For a wrong autopilot, return that row only."""
    another = another_autopilot(facts, autopilot)
    if another is not None:
        return (another,)
    version = _version_of(autopilot, facts.version)
    quantities = quantities_read(facts.parameters, version, facts.uploaded)
    wants = fence.about_home(wants, facts.vehicle, autopilot.projection)
    return (
        _version_row(facts.version, autopilot),
        *(
            finding_of(rule, facts.parameters, wants, quantities)
            for rule in _rules_of(version, wants.announces)
        ),
        fence.uploaded_row(facts.uploaded, wants, facts.vehicle, autopilot, quantities),
        *_position_rows(facts, autopilot.projection, wants),
        *_stream_rows(facts, autopilot),
    )


def _position_rows(facts: Facts, projection: Projection, wants: Wants) -> Iterator[Finding]:
    """Judge home in our fence, battery, origin, home, position and height datum.

    An old estimator origin or a wrong height datum has flown vehicles into the ground. Comparing two messages about
    the same place reveals both.
    """
    latest = facts.vehicle.latest
    corners = wants.limits.fence_polygon_ne_m
    if corners is not None:
        yield _home_in_fence(corners)
    if wants.battery_needed is not None:
        yield _battery(latest.get(messages.SystemStatus), wants.battery_needed)
    origin = latest.get(messages.Origin)
    home = latest.get(messages.Home)
    if origin is None or home is None:
        yield _frame_unknown(origin, home)
        return
    frame = LocalFrame(
        origin.latitude_deg,
        origin.longitude_deg,
        Amsl(origin.altitude_amsl_m),
        projection=projection,
    )
    yield from _home_rows(home, frame, wants.preflight.origin_distance_limit_m)
    on_map = latest.get(messages.GlobalPosition)
    local = latest.get(messages.LocalPosition)
    if on_map is None or local is None:
        expected = "GLOBAL_POSITION_INT and LOCAL_POSITION_NED heard"
        advice = "wait for the estimator's position; check that both are streamed"
        yield Finding("position", "unknown", expected, Verdict.REFUSE, advice)
        return
    yield from _datum_rows(on_map, local, home, frame)
    yield from _evader_rows(facts.evader, home, frame, wants)
    if not facts.vehicle.armed:
        away_m = math.dist(local.position_ned_m[:2], home.position_ned_m[:2])
        at_home = away_m <= _AGREEMENT_M
        advice = "the fence will lie about home: set home here, unless you want it there"
        expected = f"at most {_AGREEMENT_M:g} m"
        value = f"{away_m:.1f} m from home"
        yield Finding.of(at_home, "vehicle at home", value, expected, advice, Verdict.WARN)


def _home_in_fence(corners: Sequence[Point]) -> Finding:
    inside = bool(contains(corners, np.zeros((1, 2)))[0])
    value = "inside" if inside else "outside"
    return Finding.of(inside, "home in our fence", value, "inside", "is this the right field?")


def _frame_unknown(origin: messages.Origin | None, home: messages.Home | None) -> Finding:
    missing = []
    if origin is None:
        missing.append("GPS_GLOBAL_ORIGIN")
    if home is None:
        missing.append("HOME_POSITION")
    expected = f"{' and '.join(missing)} heard"
    return Finding("local frame", "unknown", expected, Verdict.REFUSE, "wait for a position fix")


def _home_rows(home: messages.Home, frame: LocalFrame, limit_m: float) -> Iterator[Finding]:
    """Compare home on the map with the origin, and with home in the local frame."""
    altitude = Amsl(home.altitude_amsl_m)
    home_ned_m = frame.ned_from_wgs84(home.latitude_deg, home.longitude_deg, altitude)
    away_m = math.hypot(*home_ned_m[:2])
    advice = "restart the autopilot here: its origin is old"
    yield _limit_finding("frame origin", away_m, limit_m, "m from home", advice)
    apart_m = math.dist(home_ned_m, home.position_ned_m)
    advice = "home was set in another frame: set it again"
    yield _limit_finding("home in the frame", apart_m, _AGREEMENT_M, "m apart", advice)


def _datum_rows(
    on_map: messages.GlobalPosition,
    local: messages.LocalPosition,
    home: messages.Home,
    frame: LocalFrame,
) -> Iterator[Finding]:
    """Compare the position on the map with the one in the local frame, and the heights above sea level and home."""
    altitude = Amsl(on_map.altitude_amsl_m)
    on_map_ned_m = frame.ned_from_wgs84(on_map.latitude_deg, on_map.longitude_deg, altitude)
    apart_m = math.dist(on_map_ned_m, local.position_ned_m)
    advice = "LOCAL_POSITION_NED and GLOBAL_POSITION_INT contradict each other: restart the autopilot here"
    yield _limit_finding("local = global", apart_m, _AGREEMENT_M, "m apart", advice)
    home_amsl_m = on_map.altitude_amsl_m - on_map.altitude_above_home_m
    difference_m = abs(home_amsl_m - home.altitude_amsl_m)
    advice = "the altitudes have different datums (sea level, ellipsoid, home?)"
    yield _limit_finding("datum of home", difference_m, _HOME_HEIGHT_M, "m apart", advice)


def _evader_rows(
    evader: EvaderReport | None, home: messages.Home, frame: LocalFrame, wants: Wants
) -> Iterator[Finding]:
    """Judge the evader's altitude, and whether it can be met inside our fence."""
    name = "evader's altitude"
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


def _limit_finding(name: str, value_m: float, limit_m: float, words: str, advice: str) -> Finding:
    value = f"{value_m:.1f} {words}"
    return Finding.of(value_m <= limit_m, name, value, f"at most {limit_m:g} m", advice)


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
    version = _version_of(autopilot, facts.version)
    uploaded = facts.uploaded
    if unread_fence:
        uploaded = Uploaded(problem=unread_fence)
    quantities = quantities_read(facts.parameters, version, uploaded)
    wants = fence.about_home(wants, facts.vehicle, autopilot.projection)
    rows = []
    for rule in _rules_of(version, wants.announces):
        if rule.needed:
            row = finding_of(rule, facts.parameters, wants, quantities)
            if rule.name not in facts.parameters:
                row = row._replace(value="not answered", advice="check the link")
            rows.append(row)
    fence_row = fence.uploaded_row(uploaded, wants, facts.vehicle, autopilot, quantities)
    return (*rows, fence_row)


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


def quantities_read(
    parameters: Mapping[str, float], version: Version, uploaded: Uploaded
) -> dict[str, float]:
    """Return the values read, by quantity and in its unit."""
    quantities: dict[str, float] = {
        rule.quantity: parameters[rule.name] * rule.unit
        for rule in version.rules
        if rule.name in parameters
    }
    if uploaded.areas is not None:
        encloses = any(area.inclusion for area in uploaded.areas)
        quantities[Quantity.UPLOADED_INCLUSION] = float(encloses)
    return quantities


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


def changes(
    facts: Facts, autopilot: Autopilot, wants: Wants, *, advised: bool = False
) -> tuple[ParameterChange, ...]:
    """Return the parameters to set so that none is refused any more, where a rule has a value to set.

    One change can require another, so each is judged with those before it, and the rules are applied repeatedly.

    Args:
        facts: The answers so far.
        autopilot: The vehicle's autopilot.
        wants: The configuration's demands.
        advised: Whether to change parameters with a warning, too.
    """
    version = _version_of(autopilot, facts.version)
    wants = fence.about_home(wants, facts.vehicle, autopilot.projection)
    fit = {Verdict.PASS}
    if not advised:
        fit.add(Verdict.WARN)
    concerned = _rules_of(version, wants.announces)
    rules = [rule for rule in concerned if rule.name in facts.parameters]
    after = dict(facts.parameters)
    wrong = dict[str, Judgement]()
    for _ in range(_MOST_ROUNDS):
        for rule in rules:
            quantities = quantities_read(after, version, facts.uploaded)
            judgement = rule.judged(after[rule.name], wants, quantities)
            if judgement.verdict not in fit and judgement.set_to is not None:
                after[rule.name] = single(judgement.set_to)
                wrong.setdefault(rule.name, judgement)
    return tuple(
        _change(rule, facts, after[rule.name], wrong[rule.name])
        for rule in rules
        if after[rule.name] != facts.parameters[rule.name]
    )


def _change(rule: Rule, facts: Facts, value: float, judgement: Judgement) -> ParameterChange:
    reason = judgement.wanted
    if judgement.why:
        reason = f"{reason}; {judgement.why}"
    return ParameterChange(
        rule.name,
        rule.read(facts.parameters[rule.name]),
        rule.read(value),
        reason,
        judgement.verdict,
        ParameterSet(rule.name, value, facts.parameter_types.get(rule.name, _REAL32)),
    )


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
