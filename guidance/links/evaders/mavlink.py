"""Reports of an evader from MAVLink messages of one pinned system on a wire, and the messages that vehicles send.

An evader that answers TIMESYNC is asked once a second for its clock, so that the age of a report is measured and not
guessed. Its answer goes along with its next report, if the report's own time agrees with it: some messages carry
another clock than TIMESYNC does.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final, Protocol

from guidance.frames import LocalFrame, Vector
from guidance.links.arrivals import Clock
from guidance.links.decode import Fields, decode, degrees, finite
from guidance.links.encode import Station
from guidance.links.evaders.carrier import (
    UNKNOWN_VELOCITY,
    Refused,
    SenderClock,
    boot_ms_clock,
    finite_altitude,
    rotate,
    standard_deviation,
)
from guidance.links.framing import CRC_EXTRA, NAMES, Frame, Framer, fields_of
from guidance.links.port import Wire
from guidance.links.requests import TimesyncPeer
from guidance.links.signing import SigningKey
from guidance.messages import AltitudeSaid, Datum, EvaderReport, GlobalPosition, Timesync

OWN_COMPONENT_ID: Final = 195
_CLOCKS_AGREE_S: Final = 0.1
_LONGEST_DELAY_S: Final = 5.0
MAV_FRAME_LOCAL_NED: Final = 1
MAV_FRAME_BODY_FRD: Final = 12
_DIAGONAL: Final = (0, 6, 11)  # of the upper right triangle of a 6 x 6 matrix, row by row
CAPABILITY_VELOCITY: Final = 1 << 1


class Carrier(Protocol):
    """How one MAVLink message becomes a report. It may remember the sender's clock."""

    @property
    def message(self) -> str:
        """The message's name."""

    def report(self, fields: Fields, received_s: float) -> EvaderReport:
        """Turn fields into a report.

        Raises:
            Refused: If it must not be used.
        """


class MavlinkEvader:
    """`EvaderSource` over a wire. The system id is pinned: when it falls silent, nobody takes its place."""

    def __init__(
        self,
        wire: Wire,
        carrier: Carrier,
        *,
        system_id: int,
        component_id: int | None = None,
        clock: Clock | None = None,
        signing_key: SigningKey | None = None,
        unix_s: float = 0.0,
    ) -> None:
        """Take over a wire.

        Args:
            wire: Closed with the source.
            carrier: Of which message, and how it is read.
            system_id: The evader's.
            component_id: None hears any component.
            clock: Without one nothing is ever sent.
            signing_key: Only frames are heard that are signed with it, and ours are; None signs and asks for nothing.
            unix_s: The calendar's time, needed for signing only, s.
        """
        self._wire = wire
        self._carrier = carrier
        self._system_id = system_id
        self._component_id = component_id
        self._framer = Framer(CRC_EXTRA)
        signing = {} if clock is None else {"clock": clock}
        self._station = Station(system_id, OWN_COMPONENT_ID, signing_key=signing_key, unix_s=unix_s, **signing)
        self._clock = clock
        self._timesync = TimesyncPeer()
        self._answer: Timesync | None = None
        self._counts: Counter[str] = Counter()

    def receive(self) -> Sequence[EvaderReport]:
        """All reports since the last call, in order of arrival."""
        reports = []
        for received_s, data in self._wire.receive():
            for frame in self._framer.feed(data, stream=self._wire.stream):
                if self._is_meant(frame):
                    reports += self._read(frame, received_s)
        if (
            self._clock is not None
            and self._counts["reports"]
            and (now_s := self._clock()) >= self._timesync.next_ask_s
        ):
            self._wire.send(self._station.pack("TIMESYNC", self._timesync.ask(now_s)))
        return reports

    def _is_meant(self, frame: Frame) -> bool:
        if NAMES[frame.message_id] not in (self._carrier.message, "TIMESYNC"):
            return False
        if frame.system_id != self._system_id or self._component_id not in (None, frame.component_id):
            self._counts["foreign"] += 1
            return False
        doubts = self._station.doubts(frame)
        if doubts is not None:
            self._counts[doubts] += 1
        return doubts is None

    def _read(self, frame: Frame, received_s: float) -> list[EvaderReport]:
        try:
            fields = fields_of(frame)
            if NAMES[frame.message_id] == "TIMESYNC":
                answer, _ = self._timesync.hear(fields, received_s)
                self._answer = answer or self._answer
                return []
            report = self._with_answer(self._carrier.report(fields, received_s))._replace(sequence=frame.sequence)
        except Refused as refused:
            self._counts[f"refused_{refused.reason}"] += 1
            return []
        except (ValueError, ArithmeticError):
            self._counts["refused_invalid"] += 1
            return []
        self._counts["reports"] += 1
        return [report]

    def _with_answer(self, report: EvaderReport) -> EvaderReport:
        answer, self._answer = self._answer, None
        if answer is None:
            return report
        theirs_less_ours_s = answer.remote_ns / 1e9 - 0.5 * (answer.local_ns / 1e9 + answer.received_s)
        delay_s = report.received_s - (report.sent_s - theirs_less_ours_s)
        if not -_CLOCKS_AGREE_S < delay_s < _LONGEST_DELAY_S:
            self._counts["clock_disagrees"] += 1
            return report
        self._counts["clock_answers"] += 1
        return report._replace(timesync=answer)

    def counters(self) -> Mapping[str, int]:
        """Reports, and what was refused, by reason."""
        return {"reports": 0, "foreign": 0, "garbage_bytes": self._framer.garbage_bytes, **self._counts}

    def close(self) -> None:
        """Close the wire."""
        self._wire.close()


@dataclass(slots=True)
class FollowTarget:
    """Carrier of FOLLOW_TARGET, which phones, ground stations and beacons send.

    * Position: WGS-84 degrees; altitude above mean sea level, metres.
    * Velocity: north, east, down, m/s. (0, 0, 0) means unknown, by the message's definition, as does a velocity whose
      bit in `est_capabilities` is not set although others are. Many senders fill in no capabilities at all.
    * Accuracy: `position_cov` carries standard deviations (ground stations put "eph, epv" there), zero for unknown.
    * Clock: milliseconds since the sender's boot, unwrapped at 2^32 since many senders count in 32 bits.
    """

    message: ClassVar[str] = "FOLLOW_TARGET"
    clock: SenderClock = field(default_factory=boot_ms_clock)

    def report(self, fields: Fields, received_s: float) -> EvaderReport:
        """Turn the message into a report."""
        latitude, longitude = degrees(fields["lat"], fields["lon"])
        return EvaderReport(
            received_s=received_s,
            sent_s=self.clock.unwrap(fields["timestamp"] % 2**32) / 1e3,
            source=self.message,
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_amsl_m=finite_altitude(fields["alt"]),
            velocity_ned_m_s=_follow_target_velocity(fields),
            position_sd_m=standard_deviation(*(value * abs(value) for value in fields["position_cov"])),
            velocity_sd_m_s=math.nan,
            said=AltitudeSaid(fields["alt"], Datum.AMSL),
        )


def _follow_target_velocity(fields: Fields) -> Vector:
    north, east, down = fields["vel"]
    capabilities = fields["est_capabilities"]
    said_unknown = capabilities != 0 and not capabilities & CAPABILITY_VELOCITY
    if said_unknown or (north, east, down) == (0.0, 0.0, 0.0) or not math.isfinite(north + east + down):
        return UNKNOWN_VELOCITY
    return north, east, down


@dataclass(slots=True)
class GlobalPositionInt:
    """Carrier of GLOBAL_POSITION_INT, another vehicle's.

    * Position: WGS-84 degrees; `alt` above mean sea level, millimetres (`relative_alt`, above its home, is not used:
      its home is not ours).
    * Velocity: north, east, down, cm/s. Always given; a vehicle at rest says zero and means it.
    * Clock: `time_boot_ms`, unwrapped at 2^32.
    """

    message: ClassVar[str] = "GLOBAL_POSITION_INT"
    clock: SenderClock = field(default_factory=boot_ms_clock)

    def report(self, fields: Fields, received_s: float) -> EvaderReport:
        """Turn the message into a report."""
        heard = decode(self.message, fields, received_s)
        if not isinstance(heard, GlobalPosition):
            raise Refused("invalid")
        return self.report_of(heard)

    def report_of(self, heard: GlobalPosition) -> EvaderReport:
        """The same from the typed value, for an evader that has a link of its own."""
        return EvaderReport(
            received_s=heard.received_s,
            sent_s=self.clock.unwrap(heard.time_boot_s * 1e3) / 1e3,
            source=self.message,
            latitude_deg=heard.latitude_deg,
            longitude_deg=heard.longitude_deg,
            altitude_amsl_m=finite_altitude(heard.altitude_amsl_m),
            velocity_ned_m_s=heard.velocity_ned_m_s,
            position_sd_m=math.nan,
            velocity_sd_m_s=math.nan,
            said=AltitudeSaid(heard.altitude_amsl_m, Datum.AMSL),
        )


@dataclass(frozen=True, slots=True)
class OdometryCarrier:
    """Carrier of ODOMETRY, another vehicle's pose in its own local frame, so `frame`'s origin has to be told.

    * Position: metres in MAV_FRAME_LOCAL_NED about that origin (the evader's GPS_GLOBAL_ORIGIN, altitude above mean
      sea level). Other frames are refused: LOCAL_FRD does not know where north is.
    * Velocity: in `child_frame_id`, LOCAL_NED as it is, BODY_FRD turned by the attitude; unknown in any other.
    * Accuracy: the largest of the three axes' variances, NaN for unknown, which is what MAVLink says with NaN or zero.
    * Clock: `time_usec`, the sender's, 64 bits: it does not wrap.
    """

    frame: LocalFrame
    message: ClassVar[str] = "ODOMETRY"

    def report(self, fields: Fields, received_s: float) -> EvaderReport:
        """Turn the message into a report."""
        if fields["frame_id"] != MAV_FRAME_LOCAL_NED:
            raise Refused("frame")
        position = finite(fields["x"], fields["y"], fields["z"])
        if max(map(abs, position)) > 1e6:
            raise Refused("position")
        latitude, longitude, altitude = self.frame.wgs84_from_ned(position)
        pose, velocity = fields["pose_covariance"], fields["velocity_covariance"]
        return EvaderReport(
            received_s=received_s,
            sent_s=fields["time_usec"] / 1e6,
            source=self.message,
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_amsl_m=finite_altitude(altitude.metres),
            velocity_ned_m_s=_odometry_velocity(fields),
            position_sd_m=standard_deviation(*(pose[index] for index in _DIAGONAL)),
            velocity_sd_m_s=standard_deviation(*(velocity[index] for index in _DIAGONAL)),
            said=AltitudeSaid(-position[2], Datum.ORIGIN),
        )


def _odometry_velocity(fields: Fields) -> Vector:
    try:
        velocity = finite(fields["vx"], fields["vy"], fields["vz"])
    except ValueError:
        return UNKNOWN_VELOCITY
    if fields["child_frame_id"] == MAV_FRAME_LOCAL_NED:
        return velocity
    if fields["child_frame_id"] == MAV_FRAME_BODY_FRD:
        return rotate(fields["q"], velocity)
    return UNKNOWN_VELOCITY
