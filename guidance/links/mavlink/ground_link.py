"""The service as ground stations see it on the vehicle's link: an onboard computer that reports its state.

It shares the wire with the vehicle's link. Autopilots forward its messages to their other links, and commands from
there to it. It has numbers and signatures of its own, because the vehicle's link is another component.
Sources: MAVLink's command protocol (mavlink.io/en/services/command.html), STATUSTEXT and ADSB_VEHICLE of its common
dialect.
"""

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Final, NamedTuple

from fastcrc import crc16
from pymavlink.dialects.v20 import common as mavlink

from guidance.frames import Ned, Place
from guidance.links.mavlink.codec import VALID_MOTION
from guidance.links.mavlink.frames import Fields, Frame, FrameReader, SigningKey, Station
from guidance.links.mavlink.pymavlink_link import own_heartbeat
from guidance.links.port import Clock, Wire

COMPONENT_ID: Final = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER

MOST_COMMANDS_PER_S: Final = 10
"""Commands of one ground station; more in the same second are dropped and counted. Only genuine frames count."""

MOST_FORGED_PER_S: Final = 1000
"""Frames with a wrong signature that are checked; then no signature is checked until the next second.

One check takes a few microseconds. Unsigned frames are refused without one.
"""

_TEXT_BYTES: Final = 50
_MOST_TEXT_BYTES: Final = 200
_CALL_SIGN_BYTES: Final = 8
_NO_SQUAWK: Final = 0
_TEMPORARY_ADDRESSES: Final = 0xF00000
"""Start of the ICAO addresses that no state gives to an aircraft."""

_UNKNOWN_COURSE_BELOW_M_S: Final = 0.1
_UNSIGNED: Final = ("unsigned", "refused", "unsaved")


class StationCommand(NamedTuple):
    """A COMMAND_LONG of a ground station to us.

    Attributes:
        system_id: Of the sender.
        component_id: Of the sender.
        command: Its number.
        signed: Whether its signature was checked.
        parameters: Its seven parameters as texts, so that unknown values (NaN) are equal.
        repeated: Whether the sender says that it repeats a command whose answer it has not heard.
    """

    system_id: int
    component_id: int
    command: int
    signed: bool
    parameters: tuple[str, ...]
    repeated: bool

    @property
    def first(self) -> "StationCommand":
        """The command that this one repeats."""
        return self._replace(repeated=False)


def address_of(evader: str) -> int:
    """Return the ICAO address under which an evader is announced: the same for all vehicles that pursue it."""
    return _TEMPORARY_ADDRESSES | (crc16.mcrf4xx(evader.encode()) & 0x7FFF)


class GroundLink:
    """The service's second component on a vehicle's wire.

    Args:
        wire: A share of the vehicle's; it is closed with the link.
        clock: Time of signatures.
        system_id: The vehicle's, which is ours too.
        stations: System ids of the ground stations whose commands are read.
        signing_key: Sign our messages and drop unsigned commands; None does neither.
    """

    def __init__(
        self,
        wire: Wire,
        clock: Clock,
        *,
        system_id: int,
        stations: Collection[int] = (),
        signing_key: SigningKey | None = None,
    ) -> None:
        self._wire = wire
        self._system_id = system_id
        self._stations = frozenset(stations)
        self._station = Station(wire, system_id, COMPONENT_ID, signing_key=signing_key, clock=clock)
        self._frames = FrameReader({"COMMAND_LONG", "HEARTBEAT"})
        self._text_id = 0
        self._second = 0
        self._commands = Counter[int]()
        self._forged = 0
        self._closed = False
        self.counts: Counter[str] = Counter()

    def receive(self) -> Sequence[StationCommand]:
        """Return the commands to us since the last call, oldest first. Bad and foreign ones are dropped and counted."""
        if self._closed:
            return []
        commands = []
        for received_s, data in self._wire.receive():
            if int(received_s) != self._second:
                self._second = int(received_s)
                self._commands.clear()
                self._forged = 0
            for frame in self._frames.read(data):
                if frame.name == "HEARTBEAT":
                    # The disk has a bound on a station's timestamps before its first command needs one.
                    if frame.system_id in self._stations:
                        self._problem(frame)
                    continue
                fields = frame.fields
                to = (fields.target_system, fields.target_component)
                if to != (self._system_id, COMPONENT_ID):
                    continue
                if frame.system_id not in self._stations:
                    self.counts["foreign"] += 1
                    continue
                problem = self._problem(frame)
                if problem is None:
                    self._commands[frame.system_id] += 1
                    if self._commands[frame.system_id] > MOST_COMMANDS_PER_S:
                        problem = "dropped"
                if problem is not None:
                    self.counts[problem] += 1
                    continue
                self.counts["commands"] += 1
                command = StationCommand(
                    frame.system_id,
                    frame.component_id,
                    fields.command,
                    signed=self._station.check is not None,
                    parameters=tuple(
                        str(getattr(fields, f"param{number}")) for number in range(1, 8)
                    ),
                    repeated=fields.confirmation > 0,
                )
                commands.append(command)
        return commands

    def _problem(self, frame: Frame) -> str | None:
        """Return why a frame is not genuine, as `SignatureCheck.problem`; None if it is, or without a key."""
        check = self._station.check
        if check is None:
            return None
        if self._forged >= MOST_FORGED_PER_S:
            return "dropped"
        problem = check.problem(frame)
        self._forged += problem == "refused"
        return problem

    def answer(self, command: StationCommand, result: int) -> None:
        """Send a COMMAND_ACK with a MAV_RESULT to the sender of a command."""
        self._send(
            mavlink.MAVLink_command_ack_message(
                command.command, result, 0, 0, command.system_id, command.component_id
            )
        )

    def send_heartbeat(self) -> None:
        """Send the HEARTBEAT of an onboard computer."""
        self._send(own_heartbeat())

    def send_text(self, severity: int, words: str) -> None:
        """Send a STATUSTEXT, in chunks if it is long; `severity` is MAV_SEVERITY."""
        encoded = words.encode("ascii", "replace")[:_MOST_TEXT_BYTES]
        if len(encoded) <= _TEXT_BYTES:
            self._send(mavlink.MAVLink_statustext_message(severity, encoded))
            return
        self._text_id = self._text_id % 0xFFFF + 1
        # A chunk that is not full ends the text, an empty one if need be
        for number, begin in enumerate(range(0, len(encoded) + 1, _TEXT_BYTES)):
            chunk = encoded[begin : begin + _TEXT_BYTES]
            self._send(mavlink.MAVLink_statustext_message(severity, chunk, self._text_id, number))

    def send_evader(
        self, evader: str, place: Place, velocity_ned_m_s: Ned, age_s: float, call_sign: str
    ) -> None:
        """Send an ADSB_VEHICLE of a ground vehicle.

        Args:
            evader: Its name, which makes its address.
            place: Latitude and longitude, degrees, and altitude above mean sea level.
            velocity_ned_m_s: North, east, down.
            age_s: Time since its last report.
            call_sign: Eight characters at most.
        """
        latitude_deg, longitude_deg, altitude = place
        north_m_s, east_m_s, down_m_s = velocity_ned_m_s
        speed_m_s = math.hypot(north_m_s, east_m_s)
        course_rad = 0.0
        if speed_m_s >= _UNKNOWN_COURSE_BELOW_M_S:
            course_rad = math.atan2(east_m_s, north_m_s) % math.tau
        flags = (
            mavlink.ADSB_FLAGS_VALID_COORDS
            | mavlink.ADSB_FLAGS_VALID_ALTITUDE
            | mavlink.ADSB_FLAGS_VALID_CALLSIGN
            | VALID_MOTION
        )
        self._send(
            mavlink.MAVLink_adsb_vehicle_message(
                address_of(evader),
                round(latitude_deg * 1e7),
                round(longitude_deg * 1e7),
                mavlink.ADSB_ALTITUDE_TYPE_PRESSURE_QNH,
                round(altitude.metres * 1e3),
                round(math.degrees(course_rad) * 100.0) % 36000,
                min(round(speed_m_s * 100.0), 0xFFFF),
                max(-0x7FFF, min(round(-down_m_s * 100.0), 0x7FFF)),
                call_sign.encode("ascii", "replace")[:_CALL_SIGN_BYTES],
                mavlink.ADSB_EMITTER_TYPE_SERVICE_SURFACE,
                max(0, min(round(age_s), 0xFF)),
                flags,
                _NO_SQUAWK,
            )
        )

    def _send(self, message: Fields) -> None:
        if not self._closed:
            self._station.send(message)
            self.counts["sent"] += 1

    def counters(self) -> Mapping[str, int]:
        """Return how many messages were sent, and commands read and dropped, by reason."""
        names = ("sent", "commands", "foreign", "dropped", *_UNSIGNED)
        return {**dict.fromkeys(names, 0), **self.counts}

    def close(self) -> None:
        """Close this share of the wire; may be called twice."""
        self._closed = True
        self._wire.close()
