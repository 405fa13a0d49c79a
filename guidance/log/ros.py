"""A flight as ROS 2 messages, made from the entries of its record: for a bag, and for live topics.

Frames follow REP 103 and REP 105, axes east, north, up:

* `map`: the game frame, about the site of the game or else the vehicle's first local origin. In a team without a common
  site every vehicle has its own, `NAME/map`.
* `NAME/odom`: the autopilot's local frame. It moves in `map` when the autopilot moves its origin.
* `NAME/base_link`: the vehicle, forward, left, up. Only its heading is known; roll and pitch are zero.
* `NAME/evader`: the estimated evader, with the axes of `map`.
* `earth`: Earth-centred. Altitudes above mean sea level stand in for heights above the ellipsoid there.

A stamp is the flight's clock, counted from the Unix time of the record's beginning; 1970 in virtual time.
Covariances are zero, which means unknown.
"""

import math
import re
from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import pymap3d

from guidance.cycle import Alarm, Certificate
from guidance.flight import BEFORE_FLIGHT, State
from guidance.flight.tracking import Tracking
from guidance.frames import STILL, Enu, GameFrame, LocalFrame, game_from_ned
from guidance.game import Reason, Winner
from guidance.game.arrays import FloatArray
from guidance.links.zenoh import ros_types
from guidance.log.aggregator import SettingsOf
from guidance.log.entries import BEGINNINGS, CONFIG, RELOADED, CycleEntry, EventEntry
from guidance.log.scene import disc, isochron_at, lifted
from guidance.messages import Attitude, LocalPosition, SystemStatus
from guidance.vehicle import VehicleState, observe


class Topic(NamedTuple):
    """A topic: its name, absolute or below the vehicle's name, its type, and the least time between two messages."""

    name: str
    type_name: str
    every_s: float


MOTION_EVERY_S: Final = 0.04
ISOCHRON_EVERY_S: Final = 0.5
"""Period of the isochron among the markers. It costs more than all else: 4 ms."""

ODOMETRY_TOPIC: Final = Topic("odometry", ros_types.ODOMETRY_TYPE, MOTION_EVERY_S)
EVADER_TOPIC: Final = Topic("evader/odometry", ros_types.ODOMETRY_TYPE, MOTION_EVERY_S)
SETPOINT: Final = Topic("setpoint", ros_types.TWIST_STAMPED, MOTION_EVERY_S)
TRANSFORMS: Final = Topic("/tf", ros_types.TRANSFORMS_TYPE, MOTION_EVERY_S)
MARKERS: Final = Topic("markers", ros_types.MARKERS_TYPE, 0.2)
PATH: Final = Topic("path", ros_types.PATH_TYPE, 1.0)
DIAGNOSTICS: Final = Topic("/diagnostics", ros_types.DIAGNOSTICS_TYPE, 1.0)

TOPICS: Final = (ODOMETRY_TOPIC, EVADER_TOPIC, SETPOINT, TRANSFORMS, MARKERS, PATH, DIAGNOSTICS)
"""All topics of a vehicle. A change of state and an alarm are on `/diagnostics` at once."""

_MAP: Final = "map"
EARTH: Final = "earth"

MOST_POSES: Final = 600
"""Poses of a path, one each second: the last ten minutes."""

_ALARM_SHOWN_S: Final = 5.0

_EARTH_EVERY_S: Final = 1.0
_EARLY: Final = 0.9
"""A message is due after this share of its period, since cycles do not fall on its grid."""

_POINTS: Final = 73
_LINE: Final = 4
_SPHERE: Final = 2
_ADD: Final = 0
_SHOWN_S: Final = 1
"""A marker disappears after this time if no newer one comes."""

_OK: Final = 0
_WARN: Final = 1
_ERROR: Final = 2
_LEVELS: Final[Mapping[State, int]] = {
    State.FAILED: _ERROR,
    State.YIELDED: _WARN,
    State.PAUSED: _WARN,
    State.OUT_OF_CONTACT: _WARN,
}
"""Levels of states in DiagnosticStatus; others are OK."""

_ISOCHRON_COLOUR: Final = (0.90, 0.80, 0.20, 1.0)
_DISC_COLOUR: Final = (0.18, 0.49, 0.20, 1.0)
_MEETING_COLOUR: Final = (0.70, 0.15, 0.12, 1.0)

Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""

_UPRIGHT: Final[Quaternion] = (0.0, 0.0, 0.0, 1.0)
_STILL: Final = Enu((0.0, 0.0, 0.0))


class RosMessage(NamedTuple):
    """One message: its topic with the vehicle's name, and its content."""

    topic: str
    content: ros_types.RosValue


def ros_name(name: str) -> str:
    """Return a name as ROS takes it: lower case, digits and single underscores, a letter first."""
    plain = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    return plain if plain[:1].isalpha() else f"v{plain}"


def topic_name(vehicle: str, topic: Topic) -> str:
    """Return the full name of a topic; `vehicle` is a name of ROS."""
    return topic.name if topic.name.startswith("/") else f"/{vehicle}/{topic.name}"


class RosFlight:
    """Makes the messages of one vehicle. It follows the flight's tracks as the flight does.

    Args:
        vehicle: Its name, or the name of the record.
        settings_of: Makes settings from metadata.
        metadata: Of the flight.
        started_unix_s: Unix time of the zero of the flight's clock.

    Attributes:
        name: The vehicle's name in ROS.

    Raises:
        ConfigError: If `rosbags` is not installed, or the metadata has no settings.
    """

    def __init__(
        self,
        vehicle: str,
        settings_of: SettingsOf,
        metadata: Mapping[str, str],
        started_unix_s: float,
    ) -> None:
        ros_types.prepare("ROS 2", *(topic.type_name for topic in TOPICS))
        self.name = ros_name(vehicle)
        self._started_unix_s = started_unix_s
        self._settings_of = settings_of
        self._settings = settings_of(metadata)
        self._begin()

    def _begin(self) -> None:
        self._tracking = Tracking(self._settings)
        self._vehicle = VehicleState()
        self._state = State.CONNECTING
        self._sent_s: dict[str, float] = {}
        self._poses = deque[ros_types.RosValue](maxlen=MOST_POSES)
        self._alarm: Alarm | None = None
        self._alarm_s = -math.inf
        self._alarms = 0
        self._motion_s = math.nan
        self._motion: tuple[Enu, Enu] | None = None

    @property
    def map_frame(self) -> str:
        """The fixed frame: common to all, or the vehicle's own in a team without a common site."""
        has_team = self._settings.team is not None
        return f"{self.name}/{_MAP}" if has_team and self._settings.cycle.site is None else _MAP

    def event(self, entry: EventEntry) -> None:
        """Follow an event: some begin another flight."""
        if entry.event == RELOADED:
            self._settings = self._settings_of({CONFIG: entry.detail})
        if entry.event in BEGINNINGS:
            self._begin()

    def cycle(
        self, entry: CycleEntry, wanted: Collection[Topic] = frozenset(TOPICS)
    ) -> Iterator[RosMessage]:
        """Yield the messages of a cycle on the wanted topics that are due."""
        # Update the tracks, and note whether the state changed or an alarm came.
        inputs = entry.inputs
        tracking = self._tracking
        if inputs.role is not None:
            tracking.playing = inputs.role.evader
        self._vehicle = observe(self._vehicle, inputs.messages)
        tracking.observe(self._vehicle, inputs.reports, in_flight=self._state not in BEFORE_FLIGHT)
        tracking.news.clear()
        changed = entry.state is not self._state
        self._state = entry.state
        if entry.alarm is not None:
            self._alarm = entry.alarm
            self._alarm_s = entry.now_s
            self._alarms += 1
            changed = True
        pose = self._pose()
        if pose is not None and self._is_due("pose", entry.now_s, PATH.every_s):
            self._sent_s["pose"] = entry.now_s
            stamped = _types("geometry_msgs/msg/PoseStamped")
            self._poses.append(stamped(self._header(entry.now_s), pose))
        due = []
        for topic in TOPICS:
            if topic not in wanted:
                continue
            if (topic is DIAGNOSTICS and changed) or self._is_due(
                topic.name, entry.now_s, topic.every_s
            ):
                self._sent_s[topic.name] = entry.now_s
                due.append(topic)
        for topic in due:
            content = _MAKERS[topic](self, entry)
            if content is not None:
                yield RosMessage(topic_name(self.name, topic), content)

    def _is_due(self, name: str, now_s: float, every_s: float) -> bool:
        return now_s - self._sent_s.get(name, -math.inf) >= _EARLY * every_s

    def _pose(self) -> ros_types.RosValue | None:
        """Return the vehicle's pose in the map; None until its place is known."""
        local = self._vehicle.latest.get(LocalPosition)
        game = self._tracking.game_frame
        if local is None or game is None:
            return None
        position_ned_m = local.position_ned_m - self._tracking.held_back_ned_m
        return _pose(game.position_from_ned(position_ned_m), self._heading())

    def _heading(self) -> Quaternion:
        """Return the vehicle's heading; upright and to the east while it is unknown."""
        yaw_rad = _yaw_enu_rad(self._vehicle)
        return (0.0, 0.0, math.sin(0.5 * yaw_rad), math.cos(0.5 * yaw_rad))

    def _header(self, now_s: float, frame: str | None = None) -> ros_types.RosValue:
        # ROS has no negative times here; they become zero.
        seconds, nanoseconds = divmod(nanoseconds_of(self._started_unix_s + now_s), 1_000_000_000)
        stamp = _types("builtin_interfaces/msg/Time")(seconds, nanoseconds)
        return _types("std_msgs/msg/Header")(stamp, self.map_frame if frame is None else frame)

    def _odometry(self, entry: CycleEntry) -> ros_types.RosValue | None:
        local = self._vehicle.latest.get(LocalPosition)
        pose = self._pose()
        if local is None or pose is None:
            return None
        # In the axes of a level body whose nose is at that angle from east.
        velocity_enu_m_s = game_from_ned(local.velocity_ned_m_s)
        yaw_rad = _yaw_enu_rad(self._vehicle)
        east, north, up = velocity_enu_m_s
        cosine = math.cos(yaw_rad)
        sine = math.sin(yaw_rad)
        velocity_m_s = Enu((east * cosine + north * sine, north * cosine - east * sine, up))
        header = self._header(entry.now_s)
        return _odometry(header, f"{self.name}/base_link", pose, velocity_m_s)

    def _evader_motion(self, entry: CycleEntry) -> tuple[Enu, Enu] | None:
        """Return the estimated evader's place and velocity in the map; None without an estimate."""
        if self._motion_s != entry.now_s:
            self._motion_s = entry.now_s
            evader = self._tracking.evader(entry.now_s)
            game = self._tracking.game_frame
            self._motion = None
            if evader is not None and game is not None:
                velocity_ned_m_s = evader.velocity_ned_m_s
                self._motion = game.motion_from_ned(evader.position_ned_m, velocity_ned_m_s)
        return self._motion

    def _evader(self, entry: CycleEntry) -> ros_types.RosValue | None:
        motion = self._evader_motion(entry)
        if motion is None:
            return None
        position_m, velocity_m_s = motion
        header = self._header(entry.now_s)
        return _odometry(header, f"{self.name}/evader", _pose(position_m, _UPRIGHT), velocity_m_s)

    def _setpoint(self, entry: CycleEntry) -> ros_types.RosValue | None:
        if entry.setpoint is None:
            return None
        velocity_m_s = game_from_ned(entry.setpoint.velocity_ned_m_s)
        stamped = _types(ros_types.TWIST_STAMPED)
        return stamped(self._header(entry.now_s), _twist(velocity_m_s))

    def _transforms(self, entry: CycleEntry) -> ros_types.RosValue | None:
        game = self._tracking.game_frame
        local = self._vehicle.latest.get(LocalPosition)
        if game is None or local is None:
            return None
        now_s = entry.now_s
        odom = f"{self.name}/odom"
        frames = [
            self._transform(now_s, self.map_frame, odom, game.position_from_ned(STILL), _UPRIGHT),
            self._transform(
                now_s,
                odom,
                f"{self.name}/base_link",
                game_from_ned(local.position_ned_m),
                self._heading(),
            ),
        ]
        motion = self._evader_motion(entry)
        if motion is not None:
            evader = f"{self.name}/evader"
            frames.append(self._transform(now_s, self.map_frame, evader, motion[0], _UPRIGHT))
        frame = self._tracking.local_frame
        if frame is not None and self._is_due(EARTH, now_s, _EARTH_EVERY_S):
            self._sent_s[EARTH] = now_s
            place_m, turn = earth_of(frame, game)
            frames.append(self._transform(now_s, EARTH, self.map_frame, place_m, turn))
        return _types(ros_types.TRANSFORMS_TYPE)(frames)

    def _transform(
        self, now_s: float, parent: str, child: str, position_m: Sequence[float], turn: Quaternion
    ) -> ros_types.RosValue:
        transform = _types("geometry_msgs/msg/Transform")(_vector(position_m), _quaternion(turn))
        stamped = _types("geometry_msgs/msg/TransformStamped")
        return stamped(self._header(now_s, parent), child, transform)

    def _markers(self, entry: CycleEntry) -> ros_types.RosValue | None:
        certificate = entry.certificate
        if certificate is None:
            return None
        rim = disc(certificate)
        markers = [self._line(entry.now_s, 0, "standoff", [*rim, rim[0]], _DISC_COLOUR)]
        if not certificate.no_game and self._is_due("isochron", entry.now_s, ISOCHRON_EVERY_S):
            self._sent_s["isochron"] = entry.now_s
            curve = isochron_at(self._settings.cycle, certificate, _POINTS)
            height_m = certificate.evader_game_m[2]
            points = lifted(curve, height_m).tolist()
            markers.append(self._line(entry.now_s, 1, "isochron", points, _ISOCHRON_COLOUR))
        if not certificate.no_game:
            meeting_m = certificate.meeting_point_game_m
            size_m = (1.0, 1.0, 1.0)
            markers.append(
                self._marker(
                    entry.now_s, 2, "meeting_point", _SPHERE, meeting_m, size_m, _MEETING_COLOUR, []
                )
            )
        return _types(ros_types.MARKERS_TYPE)(markers)

    def _line(
        self,
        now_s: float,
        number: int,
        name: str,
        points: Sequence[Sequence[float]],
        colour: Quaternion,
    ) -> ros_types.RosValue:
        point = _types("geometry_msgs/msg/Point")
        corners = [point(*corner) for corner in points]
        return self._marker(now_s, number, name, _LINE, _STILL, (0.2, 0.0, 0.0), colour, corners)

    def _marker(
        self,
        now_s: float,
        number: int,
        name: str,
        kind: int,
        place_m: Enu,
        size_m: tuple[float, float, float],
        colour: Quaternion,
        points: Sequence[ros_types.RosValue],
    ) -> ros_types.RosValue:
        empty = np.empty(0, np.uint8)
        zero = _types("builtin_interfaces/msg/Time")(0, 0)
        header = _types("std_msgs/msg/Header")
        image = _types("sensor_msgs/msg/CompressedImage")
        return _types("visualization_msgs/msg/Marker")(
            header=self._header(now_s),
            ns=f"{self.name}/{name}",
            id=number,
            type=kind,
            action=_ADD,
            pose=_pose(place_m, _UPRIGHT),
            scale=_vector(size_m),
            color=_types("std_msgs/msg/ColorRGBA")(*colour),
            lifetime=_types("builtin_interfaces/msg/Duration")(_SHOWN_S, 0),
            frame_locked=False,
            points=list(points),
            colors=[],
            texture_resource="",
            texture=image(header(zero, ""), "", empty),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=_types("visualization_msgs/msg/MeshFile")("", empty),
            mesh_use_embedded_materials=False,
        )

    def _path(self, entry: CycleEntry) -> ros_types.RosValue | None:
        if not self._poses:
            return None
        return _types(ros_types.PATH_TYPE)(self._header(entry.now_s), list(self._poses))

    def _diagnostics(self, entry: CycleEntry) -> ros_types.RosValue:
        flight: dict[str, Any] = {"state": entry.state}
        if entry.by is not None:
            flight["by"] = entry.by
        flight["armed"] = self._vehicle.armed
        system = self._vehicle.latest.get(SystemStatus)
        if system is not None:
            flight["battery_remaining"] = system.battery_remaining
        if self._tracking.playing:
            flight["evader"] = self._tracking.playing
        alarm_level = _OK
        alarm_words = "none"
        alarm_values: dict[str, Any] = {"count": self._alarms}
        if self._alarm is not None:
            ago_s = entry.now_s - self._alarm_s
            alarm_values |= {"last": self._alarm.words, "ago_s": ago_s}
            alarm_words = "none now"
            if ago_s <= _ALARM_SHOWN_S:
                alarm_level = _WARN
                alarm_words = self._alarm.words
        status = [
            self._status("flight", _LEVELS.get(entry.state, _OK), str(entry.state), flight),
            self._status("certificate", *_of_certificate(entry.certificate)),
            self._status("alarms", alarm_level, alarm_words, alarm_values),
        ]
        return _types(ros_types.DIAGNOSTICS_TYPE)(self._header(entry.now_s, ""), status)

    def _status(
        self, part: str, level: int, words: str, values: Mapping[str, Any]
    ) -> ros_types.RosValue:
        pair = _types("diagnostic_msgs/msg/KeyValue")
        pairs = [pair(key, _text(value)) for key, value in values.items()]
        status = _types("diagnostic_msgs/msg/DiagnosticStatus")
        return status(level, f"{self.name}: {part}", words, self.name, pairs)


_MAKERS: Final = {
    ODOMETRY_TOPIC: RosFlight._odometry,  # noqa: SLF001 - a table of its methods
    EVADER_TOPIC: RosFlight._evader,  # noqa: SLF001
    SETPOINT: RosFlight._setpoint,  # noqa: SLF001
    TRANSFORMS: RosFlight._transforms,  # noqa: SLF001
    MARKERS: RosFlight._markers,  # noqa: SLF001
    PATH: RosFlight._path,  # noqa: SLF001
    DIAGNOSTICS: RosFlight._diagnostics,  # noqa: SLF001
}


def _of_certificate(certificate: Certificate | None) -> tuple[int, str, dict[str, Any]]:
    if certificate is None:
        return _OK, "no game", {}
    values = certificate._asdict()
    winner = Winner(certificate.winner)
    values["winner"] = winner.word
    values["vehicle_winner"] = Winner.UNDECIDED.word
    if certificate.vehicle_winner is not None:
        values["vehicle_winner"] = Winner(certificate.vehicle_winner).word
    if certificate.reason is not None:
        values["reason"] = Reason(certificate.reason).word
    if certificate.no_game:
        return _WARN, "no game: the evader is too fast for this vehicle", values
    level = _OK if winner is Winner.PURSUER else _WARN
    return level, f"winner {winner.word}, {certificate.meeting_time_s:.1f} s to the meeting", values


def _text(value: Any) -> str:  # noqa: ANN401 - any value of an entry
    """Return a value for people: numbers to the millimetre and millisecond, vectors with commas."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.3f}"
    if isinstance(value, tuple):
        return ", ".join(map(_text, value))
    return str(value)


def _types(name: str) -> Any:  # noqa: ANN401 - a class of an extra
    return ros_types.types().types[name]


def nanoseconds_of(unix_s: float) -> int:
    """Return a time in whole nanoseconds since 1970; earlier ones become zero."""
    return max(0, round(unix_s * 1e9))


def _vector(vector: Sequence[float]) -> ros_types.RosValue:
    return _types("geometry_msgs/msg/Vector3")(*vector)


def _quaternion(turn: Quaternion) -> ros_types.RosValue:
    return _types("geometry_msgs/msg/Quaternion")(*turn)


def _pose(position_m: Sequence[float], turn: Quaternion) -> ros_types.RosValue:
    point = _types("geometry_msgs/msg/Point")(*position_m)
    return _types("geometry_msgs/msg/Pose")(point, _quaternion(turn))


def _twist(velocity_m_s: Enu) -> ros_types.RosValue:
    return _types("geometry_msgs/msg/Twist")(_vector(velocity_m_s), _vector(_STILL))


_UNKNOWN_COVARIANCE: Final[FloatArray] = np.zeros(36)


def _odometry(
    header: ros_types.RosValue, child: str, pose: ros_types.RosValue, velocity_m_s: Enu
) -> ros_types.RosValue:
    """Return an Odometry; the velocity is in the axes of the child."""
    placed = _types("geometry_msgs/msg/PoseWithCovariance")(pose, _UNKNOWN_COVARIANCE)
    twist = _twist(velocity_m_s)
    moving = _types("geometry_msgs/msg/TwistWithCovariance")(twist, _UNKNOWN_COVARIANCE)
    return _types(ros_types.ODOMETRY_TYPE)(header, child, placed, moving)


def _yaw_enu_rad(vehicle: VehicleState) -> float:
    """Return the angle from east, counter-clockwise, of the vehicle's nose; 0 while it is unknown."""
    attitude = vehicle.latest.get(Attitude)
    return 0.0 if attitude is None else 0.5 * math.pi - attitude.yaw_rad


def earth_of(frame: LocalFrame, game: GameFrame) -> tuple[tuple[float, float, float], Quaternion]:
    """Return where a game frame is on Earth: its zero in Earth-centred metres, and how it is turned."""
    latitude_deg, longitude_deg, altitude = frame.wgs84_from_ned(game.origin_ned_m)
    x, y, z = pymap3d.geodetic2ecef(latitude_deg, longitude_deg, altitude.metres)
    # East, north, up: turned by 90° + longitude about the pole, then tilted by 90° - latitude
    turn = 0.5 * math.radians(90.0 + longitude_deg)
    tilt = 0.5 * math.radians(90.0 - latitude_deg)
    quaternion = (
        math.cos(turn) * math.sin(tilt),
        math.sin(turn) * math.sin(tilt),
        math.sin(turn) * math.cos(tilt),
        math.cos(turn) * math.cos(tilt),
    )
    return (float(x), float(y), float(z)), quaternion
