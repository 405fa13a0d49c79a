"""One link of a vehicle: its decoder and encoder, its streams, its protocols and its peers."""

from __future__ import annotations

import math
from collections import deque
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.mavlink import SPEC_BY_ID, SPEC_BY_NAME, Decoder, EncodeError, Encoder
from sitl_mock.protocols import (
    Command,
    CommandAnswer,
    CommandProtocol,
    EventProtocol,
    FtpProtocol,
    HomeProtocol,
    LogProtocol,
    LogStream,
    MissionProtocol,
    ParameterProtocol,
    Place,
    Reply,
    Result,
    Session,
    ShellProtocol,
    SigningSetup,
    Streams,
    TimeProtocol,
    addressed,
    available_modes,
    is_on_earth,
    source_of,
)
from sitl_mock.telemetry import Report, builders_of
from sitl_mock.vehicle.reception import COMPONENT
from sitl_mock.vehicle.state import Severity

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sitl_mock.mavlink import Message, MessageSpec
    from sitl_mock.vehicle.autopilot import Autopilot
    from sitl_mock.vehicle.flavour import Flavour

ARDUPILOT: Final = 3
_GROUND_STATION: Final = 6  # MAV_TYPE_GCS
_GROUND_HEARD_S: Final = 2.5
_TEXT_WAITS_S: Final = 5.0
"""Without a ground station PX4 keeps its last texts this long, to send them as soon as one is heard."""
_TEXTS_WAITING: Final = 8
_CLIENT_HEARD_S: Final = 3.0
_CLIENTS_MOST: Final = 16
PROTOCOL_TICKS: Final = 2
"""Delayed answers are checked every 20 ms."""
_ONCE: Final = frozenset({"PING", "TIMESYNC"})
_SET_INTERVAL = 511
_GET_INTERVAL = 510
_REQUEST_MESSAGE = 512
_CAPABILITIES = 520
_AVAILABLE_MODES = 435
_STATUSTEXT = 253
_SEND_BANNER: Final = 42428
_SET_GLOBAL_ORIGIN = 611
_LOGGING_START = 2510
_LOGGING_STOP = 2511
_KEPT: Final = frozenset({"RADIO", "RADIO_STATUS"})
_KEPT_BY_ARDUPILOT: Final = _KEPT | {"ADSB_VEHICLE"}
_LOGGING: Final = frozenset({_LOGGING_START, _LOGGING_STOP})


TOPICS: Final = "topics"
"""Kind of a link that carries an autopilot's own topics instead of MAVLink."""


class Link:
    """One link.

    Args:
        autopilot: The vehicle.
        kind: Kind of link, which gives the default rates (onboard, gcs, quiet).
        link_id: Its number in signatures.
    """

    def __init__(self, autopilot: Autopilot, kind: str, link_id: int) -> None:
        self.autopilot = autopilot
        flavour: Flavour = autopilot.flavour
        system_id = autopilot.system_id
        signing = autopilot.signing
        self.decoder = Decoder(signing=signing, is_trusted=link_id in signing.trusted_links)
        self.encoder = Encoder(system_id, COMPONENT, signing=signing, link_id=link_id)
        self._prepared = prepared(flavour.name, flavour.withheld)
        self.streams = Streams(
            frozenset(self._prepared), flavour.rates_hz[kind], flavour.stream_rules
        )
        self.unsendable = 0
        self._requested: list[Reply] = []
        self._log_stream = LogStream(autopilot.storage.logs)
        self._ground_s = -math.inf
        self._waiting_texts = deque[tuple[float, Reply]](maxlen=_TEXTS_WAITING)
        self._heard: dict[tuple[int, int], float] = {}
        self.to_forward: list[Message] = []
        self._is_ardupilot = flavour.autopilot == ARDUPILOT
        # Methods, not lambdas: deepcopy gives a copied vehicle its own methods, but the lambdas of the original.
        self.session = Session(
            system_id,
            COMPONENT,
            own_id_only=flavour.own_id_only,
            command=CommandProtocol(
                system_id, COMPONENT, self._execute, broadcast=flavour.broadcast
            ),
            parameters=ParameterProtocol(autopilot.parameters, flavour.parameter_rules),
            missions=MissionProtocol(
                autopilot.plans,
                flavour.mission_rules,
                autopilot.set_mission_item,
                autopilot.home_place,
                autopilot.guide if flavour.mission_rules.home_first else None,
                self._tell_timeout,
            ),
            streams=self.streams,
            time=TimeProtocol(autopilot.since_boot_s, answers_ping="PING" not in flavour.withheld),
            home=HomeProtocol(autopilot.set_origin, autopilot.set_home),
            ftp=FtpProtocol(
                flavour.files(autopilot.parameters, autopilot.plans, autopilot.storage)
            ),
            logs=LogProtocol(autopilot.storage.logs, flavour.log_rules, self._is_armed),
            log_stream=self._log_stream,
            shell=ShellProtocol(self._run),
            signing=SigningSetup(signing, allowed=flavour.takes_keys),
            events=EventProtocol(autopilot.events),
        )

    def is_due(self, now_s: float) -> bool:
        """True if a stream has a message to send."""
        return self.streams.is_due(now_s)

    def counts(self) -> dict[str, int]:
        """Return the counts of the decoder."""
        return self.decoder.counts.as_dict()

    def say(self, now_s: float, texts: Sequence[Reply]) -> list[bytes]:
        """Return the frames of texts; none if this link sends no STATUSTEXT, or not before a station is heard."""
        always = self.autopilot.texts
        is_heard = now_s - self._ground_s <= _GROUND_HEARD_S
        if not self._is_silenced() and (always or (always is None and is_heard)):
            return self.pack(texts)
        if always is None:
            self._waiting_texts.extend((now_s, text) for text in texts)
        return []

    def _is_silenced(self) -> bool:
        """True if SET_MESSAGE_INTERVAL stopped this link's texts; asking for the default interval stops PX4's, too."""
        return self.streams.interval_us(_STATUSTEXT) < 0

    def receive(self, now_s: float, data: bytes) -> list[bytes]:
        """Take a datagram or a sample; return the frames that answer it."""
        frames: list[bytes] = []
        messages = self.decoder.feed(data, whole=True)
        if messages:
            client = source_of(messages[-1])
            if client not in self._heard and len(self._heard) >= _CLIENTS_MOST:
                del self._heard[next(iter(self._heard))]
            self._heard[client] = now_s
        for message in messages:
            if self._is_for_others(message):
                self.to_forward.append(message)
            if (
                self._is_ardupilot
                and message.get_type() == "PARAM_REQUEST_LIST"
                and addressed(message, self.autopilot.system_id, COMPONENT)
            ):
                banner = Command(_SEND_BANNER, (0.0,) * 7, 0, False, source_of(message), 0)
                self.autopilot.commander.execute(now_s, banner)
            replies = self.session.handle(now_s, message)
            if replies is None:
                if message.get_type() == "HEARTBEAT" and message.type == _GROUND_STATION:
                    # Texts that waited for a ground station are sent now, unless they are too old.
                    self._ground_s = now_s
                    texts = [
                        text
                        for said_s, text in self._waiting_texts
                        if now_s - said_s < _TEXT_WAITS_S
                    ]
                    if not self._is_silenced():
                        self._waiting_texts.clear()
                        frames += self.pack(texts)
                self.autopilot.take(now_s, message)
            elif replies or self._requested:
                frames += self.pack(replies)
                frames += self.pack(self._requested)
                self._requested = []
        return frames

    def _tell_timeout(self) -> None:
        """Say that a transfer of plans has timed out, as PX4 does."""
        if not self._is_ardupilot:
            self.autopilot.state.say(Severity.CRITICAL, "Operation timeout")

    def _is_for_others(self, message: Message) -> bool:
        """True if the vehicle forwards a message to its other links, as MAV_n_FORWARD and ArduPilot's routing do.

        Its own messages, those for itself alone and the state of one radio stay. ArduPilot keeps ADSB_VEHICLE, too,
        and PX4 keeps HEARTBEAT without MAV_HB_FORW_EN.
        """
        autopilot = self.autopilot
        own = (autopilot.system_id, COMPONENT)
        target = (getattr(message, "target_system", 0), getattr(message, "target_component", 0))
        if own in {(message.get_srcSystem(), message.get_srcComponent()), target}:
            return False
        kind = message.get_type()
        if kind == "HEARTBEAT":
            return bool(autopilot.parameters.get("MAV_HB_FORW_EN", 1))
        kept = _KEPT_BY_ARDUPILOT if self._is_ardupilot else _KEPT
        return kind not in kept

    def passed_on(self, messages: Sequence[Message]) -> list[bytes]:
        """Return the frames of those messages from other links that are for somebody who was heard on this one."""
        frames = []
        for message in messages:
            system = getattr(message, "target_system", 0)
            component = getattr(message, "target_component", 0)
            for heard_system, heard_component in self._heard:
                if system in {0, heard_system} and (
                    not system or component in {0, heard_component}
                ):
                    frames.append(message.get_msgbuf())
                    break
        return frames

    def clients(self, now_s: float) -> list[tuple[int, int]]:
        """Return (system id, component id) of the senders of the last seconds."""
        return [
            client for client, heard_s in self._heard.items() if now_s - heard_s <= _CLIENT_HEARD_S
        ]

    def send(self, now_s: float, tick: int) -> list[bytes]:
        """Return the frames that are due by now."""
        autopilot = self.autopilot
        frames: list[bytes] = []
        names = self.streams.due(now_s)
        if names:
            report = autopilot.report
            frame_of = self.encoder.frame
            if autopilot.conditions.telemetry_frozen:
                names = [name for name in names if name == "HEARTBEAT"]
            for name in names:
                build, spec = self._prepared[name]
                fields = build(report)
                if fields is not None:
                    try:
                        frames.append(frame_of(spec, fields))
                    except EncodeError:  # a huge setpoint that overflows when rotated
                        self.unsendable += 1
        if tick % PROTOCOL_TICKS == 0:
            replies = self.session.advance(now_s)
            if replies:
                frames += self.pack(replies)
        return frames

    def pack(self, replies: Sequence[Reply]) -> list[bytes]:
        """Return the frames of some messages."""
        pack = self.encoder.pack
        return [pack(*reply) for reply in replies]

    def _execute(self, now_s: float, command: Command) -> Sequence[CommandAnswer]:
        answers = self._answers(now_s, command)
        self.autopilot.commander.answered(command, answers)
        return answers

    def _answers(self, now_s: float, command: Command) -> Sequence[CommandAnswer]:
        flavour = self.autopilot.flavour
        if command.number in flavour.refused_commands:
            return (CommandAnswer(Result.UNSUPPORTED),)
        if command.number in _LOGGING and flavour.streams_log:
            return self._stream_log(now_s, command)
        message = self.streams.rules.old_requests.get(command.number)
        if message is not None:
            params = (float(message), *command.params[1:])
            command = command._replace(number=_REQUEST_MESSAGE, params=params)
        number = command.number
        first = command.params[0]
        result = Result.DENIED
        if number == _SET_GLOBAL_ORIGIN and number in flavour.more_commands:
            result = self._set_origin(now_s, command)
        elif number == _SET_INTERVAL:
            if math.isfinite(first):
                result = self.streams.set_interval(now_s, int(first), command.params[1])
        elif number == _GET_INTERVAL:
            if 0.0 <= first < 65536.0:
                interval_us = self.streams.interval_us(int(first))
                self._requested.append(("MESSAGE_INTERVAL", int(first), interval_us))
                result = Result.ACCEPTED
        elif number == _REQUEST_MESSAGE:
            result = self._request(command)
        elif number == _CAPABILITIES:
            refused = first != 1.0 and self._is_ardupilot
            result = Result.FAILED if refused else Result.ACCEPTED
            if not refused:
                self._requested.append(self.autopilot.identity.autopilot_version())
        else:
            return self.autopilot.commander.execute(now_s, command)
        return (CommandAnswer(result),)

    def _set_origin(self, now_s: float, command: Command) -> Result:
        """DO_SET_GLOBAL_ORIGIN, as SET_GPS_GLOBAL_ORIGIN."""
        position = Place(*command.params[4:7])
        if not (command.is_int and is_on_earth(position)):
            return Result.DENIED
        moved = self.autopilot.set_origin(now_s, position)
        return Result.ACCEPTED if moved else Result.TEMPORARILY_REJECTED

    def _request(self, command: Command) -> Result:
        """Send a message once: REQUEST_MESSAGE."""
        message_id, argument = command.params[:2]
        if not math.isfinite(message_id):
            return Result.DENIED
        autopilot = self.autopilot
        rules = self.streams.rules
        replies: list[Reply] = []
        if int(message_id) == _AVAILABLE_MODES:
            if "AVAILABLE_MODES" in autopilot.flavour.withheld:
                return rules.unknown_request
            number = int(argument) if math.isfinite(argument) else 0
            replies = available_modes(autopilot.commander.available_modes, number)
        else:
            spec = SPEC_BY_ID.get(int(message_id))
            if spec is None or spec.name not in self._prepared or spec.name in _ONCE:
                return rules.unknown_request
            fields = self._prepared[spec.name][0](autopilot.report)
            if fields is not None:
                replies = [(spec.name, *fields)]
        if not replies:
            return rules.empty_request
        self._requested += replies
        return Result.ACCEPTED

    def _stream_log(self, now_s: float, command: Command) -> Sequence[CommandAnswer]:
        """LOGGING_START and LOGGING_STOP, as PX4 answers them; one stream at a time."""
        recorder = self.autopilot.recorder
        runs = self.autopilot.storage.logs.listener is not None
        if command.number == _LOGGING_STOP:
            self._log_stream.stop()
            ended = CommandAnswer(Result.ACCEPTED)
            return (CommandAnswer(Result.IN_PROGRESS), ended) if runs else (ended,)
        if not -1.5 < command.params[0] < 0.5:  # what PX4's cast rounds to 0: the format ULog
            return (CommandAnswer(Result.UNSUPPORTED),)
        if runs:
            return (CommandAnswer(Result.TEMPORARILY_REJECTED),)
        head = recorder.head(self.autopilot.report)
        self._requested += self._log_stream.start(now_s, command.source, head)
        return (CommandAnswer(Result.ACCEPTED),)

    def _is_armed(self) -> bool:
        return self.autopilot.state.armed

    def _run(self, line: str) -> str | None:
        """Return the shell's answer to a line, None if the flavour has no shell."""
        shell = self.autopilot.flavour.shell
        return None if shell is None else shell(self.autopilot.report, line)


@lru_cache
def prepared(
    flavour: str,
    withheld: frozenset[str] = frozenset(),
) -> dict[str, tuple[Callable[[Report], tuple[Any, ...] | None], MessageSpec]]:
    """Return builder and packing of each message that a flavour can send."""
    return {
        name: (build, SPEC_BY_NAME[name])
        for name, build in builders_of(flavour).items()
        if name not in withheld
    }
