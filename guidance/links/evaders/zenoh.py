"""Reports of an evader from a Zenoh key: JSON of our own schema, or ROS 2 poses in CDR as rmw_zenoh sends them.

`config/zenoh/evader_report.schema.json` is the schema of `JsonReport`. For the ROS 2 messages geometry_msgs/PoseStamped
and nav_msgs/Odometry:

* Position: metres east, north, up (REP 103) about the origin of `frame`, whose altitude is above mean sea level.
* Velocity: PoseStamped has none. Odometry's twist is in the child frame, forward-left-up of the body, and is rotated
  by the pose's orientation.
* Accuracy: Odometry's covariances, row by row, the largest of the three axes; zero for unknown.
* Clock: `header.stamp` of the sender; zero for none.
"""

import json
import math
import threading
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Annotated, Final, Literal

import zenoh
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from guidance.errors import ConfigError, LinkError
from guidance.frames import (
    Altitude,
    Amsl,
    Ellipsoid,
    Enu,
    LocalFrame,
    Ned,
    Relative,
    ned_from_game,
)
from guidance.links.evaders.carriers import (
    RefusedReport,
    accepted,
    known_velocity,
    place_in,
    rotate,
    standard_deviation,
)
from guidance.links.port import Clock, EvaderSource, parse
from guidance.links.zenoh import ros_types
from guidance.links.zenoh.credentials import NO_CREDENTIALS, Credentials
from guidance.links.zenoh.session import Session, close_all, is_over
from guidance.links.zenoh.wire import Subscription, session_to
from guidance.messages import UNKNOWN_VELOCITY, AltitudeSaid, Datum, EvaderReport

PayloadReader = Callable[[bytes, float], EvaderReport]

_RETRY_S: Final = 2.0
"""Pause between two attempts to reach a router."""

_ROUTER_S: Final = 1.0
"""Time limit of one attempt to reach the router of an evader's reports."""

MAP_FRAME: Final = "map"
"""The frame of ROS messages by default."""

_SHOWN_LETTERS: Final = 64
MOST_REPORT_BYTES: Final = 4096
"""A larger report is dropped unread. The largest Odometry has 1.3 kB."""

_MOST_QUOTES: Final = 64
"""A report has 32. Every unknown key has two and costs an error."""

_DIAGONAL: Final = (0, 7, 14)  # of a 6 x 6 matrix, row by row
_GID_BYTES = 16
_RMW_BYTES = 33
"""rmw_zenoh attaches a number, a time, and the publisher's identity after its length."""

_DATUMS: Final[Mapping[str, type[Altitude]]] = {
    "amsl": Amsl,
    "ellipsoid": Ellipsoid,
    "relative": Relative,
}


def check_key(key: str) -> None:
    """Check a key expression before there is a session.

    Raises:
        ConfigError: If it is not a Zenoh key expression.
    """
    try:
        zenoh.KeyExpr(key)
    except zenoh.ZError as error:
        raise ConfigError(f"key = {key!r}: not a Zenoh key expression") from error


class ZenohEvader:
    """`EvaderSource` on one key expression."""

    def __init__(self, clock: Clock, session: Session, key: str, read: PayloadReader) -> None:
        """Subscribe; the session is closed with the source.

        Raises:
            ConfigError: If the key is not a Zenoh key expression.
        """
        self._read = read
        self._counts = Counter[str]()
        try:
            self._arrivals = Subscription(
                session,
                key,
                lambda sample: (clock(), sample.payload.to_bytes(), sender(sample)),
                session.close,
                most_bytes=MOST_REPORT_BYTES,
            )
        except zenoh.ZError as error:
            close_all(session.close)
            raise ConfigError(f"key = {key!r}: not a Zenoh key expression") from error
        self.close = self._arrivals.close

    def receive(self) -> Sequence[EvaderReport]:
        """Return all reports since the last call, in order of arrival."""
        reports = []
        for received_s, payload, peer in self._arrivals.take():
            report = accepted(self._counts, self._read, payload, received_s)
            if report is not None:
                reports.append(report._replace(peer=peer))
        return reports

    def counters(self) -> Mapping[str, int]:
        """Return the number of reports, and of refused ones by reason."""
        arrivals = self._arrivals
        lost = {"dropped": arrivals.dropped, "oversized": arrivals.oversized}
        return {"reports": 0, **lost, **self._counts}


class RetriedSource:
    """`EvaderSource` that is opened in the background, again and again until its router answers.

    Until then the evader is silent, like one that does not send. No other part of the daemon waits for it.

    Args:
        open_once: Opens the source, or raises LinkError within about a second.
        router: Names the router for people.
        ask: What to look at while it does not answer.
    """

    def __init__(self, open_once: Callable[[], EvaderSource], router: str, ask: str) -> None:
        self._open_once = open_once
        self._problem = f"the Zenoh router of its reports, {router}, does not answer: {ask}"
        self._source: EvaderSource | None = None
        self._failures = 1
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._retry, name=f"evader {router}")
        self._thread.start()

    def _retry(self) -> None:
        while not is_over(self._stop, _RETRY_S):
            try:
                self._source = self._open_once()
            except LinkError:
                self._failures += 1
            else:
                return

    def receive(self) -> Sequence[EvaderReport]:
        """Return all reports since the last call; none before the router answers."""
        if self._source is None:
            return ()
        return self._source.receive()

    def counters(self) -> Mapping[str, int]:
        """Return the source's counters, and how often its router did not answer."""
        counted: Mapping[str, int] = {"reports": 0}
        if self._source is not None:
            counted = self._source.counters()
        return {**counted, "router_silent": self._failures}

    def problem(self) -> str:
        """Return why no report can arrive; empty once the router has answered."""
        return self._problem if self._source is None else ""

    def close(self) -> None:
        """End the attempts, and close the source; may be called twice."""
        self._stop.set()
        self._thread.join()
        if self._source is not None:
            self._source.close()


def sender(sample: "zenoh.Sample") -> str:
    """Return the publisher of a sample as far as known: the key, and its identity in Zenoh or ROS 2."""
    source = sample.source_info
    attachment = sample.attachment
    if source is not None:
        return f"{sample.key_expr} {source.source_id}"
    attached = b"" if attachment is None else attachment.to_bytes()
    if len(attached) == _RMW_BYTES:
        return f"{sample.key_expr} {attached[-_GID_BYTES:].hex()}"
    return str(sample.key_expr)


Spread = Annotated[float, Field(gt=0.0, lt=1e6)]


class JsonReport(BaseModel):
    """One report of an evader's position, and of its velocity where that is known."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, title="guidance.EvaderReport", strict=True
    )

    sent_s: FiniteFloat | None = Field(
        default=None,
        description="When it was measured, seconds of the sender's own steady clock; null if it has none",
    )
    latitude_deg: float = Field(ge=-90.0, le=90.0, description="WGS-84 latitude, degrees")
    longitude_deg: float = Field(ge=-180.0, le=180.0, description="WGS-84 longitude, degrees")
    altitude_m: float = Field(gt=-1e5, lt=1e5, description="Altitude above the datum, metres")
    altitude_datum: Literal["amsl", "ellipsoid", "relative"] = Field(
        description="Mean sea level, the WGS-84 ellipsoid, or the pursuer's home"
    )
    velocity_ned_m_s: tuple[FiniteFloat, FiniteFloat, FiniteFloat] | None = Field(
        default=None,
        description="North, east, down, m/s; null if unknown (never zero for unknown)",
        strict=False,
    )
    position_sd_m: Spread | None = Field(
        None, description="Standard deviation of the position, largest axis, metres"
    )
    velocity_sd_m_s: Spread | None = Field(
        None, description="Standard deviation of the velocity, largest axis, m/s"
    )


def report_of_json(
    payload: bytes, received_s: float, *, frame: LocalFrame, source: str
) -> EvaderReport:
    """Convert a JSON text to a report.

    Args:
        payload: The text.
        received_s: By our clock.
        frame: The vehicle's local frame; converts altitudes above home or the ellipsoid to AMSL.
        source: The name of the source in the report.

    Raises:
        RefusedReport: If it does not match the schema, or its altitude cannot be converted in this frame.
    """
    if payload.count(b'"') > _MOST_QUOTES:
        raise RefusedReport("schema")
    try:
        message = JsonReport.model_validate_json(payload)
    except ValidationError as error:
        raise RefusedReport("schema") from error
    if message.latitude_deg == 0.0 and message.longitude_deg == 0.0:
        raise RefusedReport("position")
    altitude: Altitude = _DATUMS[message.altitude_datum](message.altitude_m)
    try:
        position = message.latitude_deg, message.longitude_deg, frame.amsl(altitude).metres
    except ConfigError as error:
        raise RefusedReport("datum") from error
    numbers = (message.sent_s, message.position_sd_m, message.velocity_sd_m_s)
    sent_s, sd_m, sd_m_s = (math.nan if number is None else number for number in numbers)
    velocity = UNKNOWN_VELOCITY
    if message.velocity_ned_m_s is not None:
        velocity = Ned(message.velocity_ned_m_s)
    altitude_said = AltitudeSaid(message.altitude_m, Datum(message.altitude_datum))
    return EvaderReport(
        received_s, sent_s, source, *position, velocity, sd_m, sd_m_s, said=altitude_said
    )


def rmw_key(topic: str, type_name: str) -> str:
    """Return the key of a topic in rmw_zenoh, for any ROS domain and type hash."""
    return f"*/{topic.strip('/')}/{ros_types.dds_name(type_name)}/*"


def read_ros(
    data: bytes, received_s: float, *, frame: LocalFrame, moves: bool, frame_id: str = MAP_FRAME
) -> EvaderReport:
    """Convert a geometry_msgs/PoseStamped, or a nav_msgs/Odometry.

    Args:
        data: Plain CDR version 1 (OMG DDS-RTPS 2.x), of either byte order.
        received_s: By our clock.
        frame: The frame that ROS calls `frame_id`.
        moves: Whether it is an Odometry.
        frame_id: Poses in other frames are refused.

    Raises:
        RefusedReport: If the bytes are not one, or it is in another frame.
    """
    try:
        message = ros_types.decode_cdr(
            data, ros_types.ODOMETRY_TYPE if moves else ros_types.POSE_STAMPED
        )
    except ValueError as error:
        raise RefusedReport("encoding") from error
    header = message.header
    if header.frame_id != frame_id:
        raise RefusedReport(
            f"frame_id {_quoted(header.frame_id)} instead of evader.frame_id = {_quoted(frame_id)}"
        )
    velocity = UNKNOWN_VELOCITY
    sd_m = math.nan
    sd_m_s = math.nan
    pose = message.pose
    if moves:
        turned = message.pose.pose.orientation
        linear = message.twist.twist.linear
        along_enu_m_s = rotate(
            (turned.w, turned.x, turned.y, turned.z), (linear.x, linear.y, linear.z)
        )
        velocity = known_velocity(ned_from_game(Enu(along_enu_m_s)))
        sd_m = _largest_sd(message.pose.covariance)
        sd_m_s = _largest_sd(message.twist.covariance)
        pose = message.pose.pose
    up_m = pose.position.z
    position = place_in(frame, ned_from_game(Enu((pose.position.x, pose.position.y, up_m))))
    altitude_said = AltitudeSaid(up_m, Datum.ORIGIN)
    sent_s = header.stamp.sec + header.stamp.nanosec / 1e9
    if sent_s == 0.0:
        sent_s = math.nan
    return EvaderReport(
        received_s, sent_s, "ROS 2", *position, velocity, sd_m, sd_m_s, said=altitude_said
    )


def _largest_sd(covariance: Sequence[float]) -> float:
    return standard_deviation(*(float(covariance[index]) for index in _DIAGONAL))


def _quoted(name: str) -> str:
    """Return a name from the wire between quotes, without control characters and not too long."""
    return json.dumps(name[:_SHOWN_LETTERS])


def _of_json(frame: LocalFrame, key: str, _frame_id: str = MAP_FRAME) -> tuple[str, PayloadReader]:
    return key, partial(report_of_json, frame=frame, source=key)


def _of_ros(
    frame: LocalFrame,
    topic: str,
    frame_id: str = MAP_FRAME,
    *,
    kind: str,
    type_name: str,
    moves: bool,
) -> tuple[str, PayloadReader]:
    ros_types.prepare(f'evader.kind = "{kind}"', type_name)
    reader = partial(read_ros, frame=frame, moves=moves, frame_id=frame_id)
    return rmw_key(topic, type_name), reader


KEYS: Final[Mapping[str, Callable[..., tuple[str, PayloadReader]]]] = {
    "json": _of_json,
    "ros_pose": partial(_of_ros, kind="ros_pose", type_name=ros_types.POSE_STAMPED, moves=False),
    "ros_odometry": partial(
        _of_ros, kind="ros_odometry", type_name=ros_types.ODOMETRY_TYPE, moves=True
    ),
}
"""Key and payload by their name in a configuration. The URL's path is the key, or the ROS topic."""


def open_source(
    kind: str,
    url: str,
    *,
    clock: Clock,
    frame: LocalFrame,
    credentials: Credentials = NO_CREDENTIALS,
    timeout_s: float = 5.0,
    frame_id: str = MAP_FRAME,
) -> EvaderSource:
    """Open a source of reports that arrive over Zenoh; for MAVLink see `MavlinkEvader`.

    Args:
        kind: A name in `KEYS`.
        url: zenoh://host:port/key.
        clock: Stamps arrivals.
        frame: The evader's declared local frame, for the datum and for positions in metres.
        credentials: For a router.
        timeout_s: Limit for connecting, in real time.
        frame_id: The frame of ROS messages.

    Raises:
        ConfigError: If the URL or the key is wrong.
        LinkError: If the router does not answer.
    """
    endpoint = parse(url)
    key, read = KEYS[kind](frame, endpoint.namespace, frame_id)
    check_key(key)
    return ZenohEvader(clock, session_to(endpoint, credentials, timeout_s), key, read)


def open_source_patiently(
    kind: str,
    url: str,
    *,
    clock: Clock,
    frame: LocalFrame,
    credentials: Credentials = NO_CREDENTIALS,
    frame_id: str = MAP_FRAME,
) -> EvaderSource:
    """Open a source as `open_source` does, but try a router that does not answer again in the background.

    An evader that is silent does not keep the vehicle from being checked, landed or brought home.

    Raises:
        ConfigError: If the URL or the key is wrong.
    """

    def open_once() -> EvaderSource:
        return open_source(
            kind,
            url,
            clock=clock,
            frame=frame,
            credentials=credentials,
            timeout_s=_ROUTER_S,
            frame_id=frame_id,
        )

    try:
        return open_once()
    except LinkError:
        ask = "is it running?"
        if credentials != NO_CREDENTIALS:
            ask = "is it running, and does it accept our certificate or user?"
        endpoint = parse(url)
        return RetriedSource(open_once, f"{endpoint.host}:{endpoint.port}", ask)
