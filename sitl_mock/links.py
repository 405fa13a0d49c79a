"""One link of a vehicle: its decoder and encoder, its streams, its protocols and its peers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.mavlink import SPEC_BY_ID, Decoder, Encoder, Signing
from sitl_mock.protocols import (
    Command,
    CommandAnswer,
    CommandProtocol,
    FtpRefusal,
    HomeProtocol,
    MissionProtocol,
    ModeEntry,
    ParameterProtocol,
    Reply,
    Result,
    Session,
    SigningSetup,
    Streams,
    TimeProtocol,
    available_modes,
)
from sitl_mock.telemetry import BUILDERS, Report

if TYPE_CHECKING:
    from sitl_mock.flavour import Flavour
    from sitl_mock.vehicle import MockVehicle

COMPONENT: Final = 1
OFFERED: Final = frozenset(BUILDERS)
_ONCE: Final = frozenset({"PING", "TIMESYNC"})
_SET_INTERVAL, _GET_INTERVAL, _REQUEST_MESSAGE, _CAPABILITIES = 511, 510, 512, 520
_AVAILABLE_MODES, _AUTOPILOT_VERSION = 435, 148


class Link:
    """One link.

    Args:
        vehicle: Whose link it is.
        kind: Which default rates it has (onboard, gcs).
        link_id: Its number in signatures.
        sequence: First packet sequence number.
    """

    def __init__(self, vehicle: MockVehicle, kind: str, link_id: int) -> None:
        self.vehicle = vehicle
        flavour: Flavour = vehicle.flavour
        system_id, signing = vehicle.system_id, vehicle.signing
        self.decoder = Decoder(signing=signing)
        self.encoder = Encoder(system_id, COMPONENT, signing=signing, link_id=link_id)
        self.streams = Streams(OFFERED, flavour.rates_hz[kind], flavour.stream_rules)
        self.ignored = 0
        self._requested: list[Reply] = []
        self.session = Session(
            system_id,
            COMPONENT,
            own_id_only=flavour.own_id_only,
            command=CommandProtocol(system_id, COMPONENT, self._execute, broadcast=flavour.broadcast),
            parameters=ParameterProtocol(vehicle.parameters, flavour.parameter_rules),
            missions=MissionProtocol(vehicle.plans, flavour.mission_rules, vehicle.set_mission_item),
            streams=self.streams,
            time=TimeProtocol(system_id, COMPONENT),
            home=HomeProtocol(vehicle.set_origin, vehicle.set_home),
            ftp=FtpRefusal(),
            signing=SigningSetup(signing),
        )

    def receive(self, now_s: float, data: bytes, *, whole: bool = True) -> list[bytes]:
        """Take bytes; return the frames that answer them."""
        frames: list[bytes] = []
        for message in self.decoder.feed(data, whole=whole):
            replies = self.session.handle(now_s, message)
            if replies is None:
                self.vehicle.take(now_s, message)
            else:
                frames += self._packed(replies)
                if self._requested:
                    frames += self._packed(self._requested)
                    self._requested = []
        return frames

    def send(self, report: Report, now_s: float, *, only_heartbeat: bool) -> list[bytes]:
        """Return the frames that are due by now."""
        frames: list[bytes] = []
        pack = self.encoder.pack
        for name in self.streams.due(now_s):
            if only_heartbeat and name != "HEARTBEAT":
                continue
            fields = BUILDERS[name](report)
            if fields is not None:
                frames.append(pack(name, *fields))
        replies = self.session.advance(now_s)
        if replies:
            frames += self._packed(replies)
        return frames

    def tell(self, replies: Sequence[Reply]) -> list[bytes]:
        """Pack messages that nobody asked for."""
        return self._packed(replies)

    def _packed(self, replies: Sequence[Reply]) -> list[bytes]:
        pack = self.encoder.pack
        return [pack(*reply) for reply in replies]

    def _execute(self, now_s: float, command: Command) -> Sequence[CommandAnswer]:
        handler = _REQUESTS.get(command.number)
        if handler is None:
            return self.vehicle.brain.execute(now_s, command)
        return (CommandAnswer(handler(self, now_s, command)),)

    def _set_interval(self, now_s: float, command: Command) -> Result:
        message_id, interval_us = command.params[:2]
        if not math.isfinite(message_id):
            return Result.DENIED
        return self.streams.set_interval(now_s, int(message_id), interval_us)

    def _get_interval(self, _now_s: float, command: Command) -> Result:
        message_id = command.params[0]
        if not 0.0 <= message_id < 65536.0:
            return Result.DENIED
        self._requested.append(("MESSAGE_INTERVAL", int(message_id), self.streams.interval_us(int(message_id))))
        return Result.ACCEPTED

    def _request(self, _now_s: float, command: Command) -> Result:
        message_id, argument = command.params[:2]
        if not math.isfinite(message_id):
            return Result.DENIED
        replies = self._message(int(message_id), int(argument) if math.isfinite(argument) else 0)
        if not replies:
            return self.streams.rules.unknown_request
        self._requested += replies
        return Result.ACCEPTED

    def _message(self, message_id: int, argument: int) -> list[Reply]:
        vehicle = self.vehicle
        if message_id == _AUTOPILOT_VERSION:
            return [vehicle.identity.autopilot_version()]
        if message_id == _AVAILABLE_MODES:
            return available_modes(mode_entries(vehicle.flavour), argument)
        spec = SPEC_BY_ID.get(message_id)
        if spec is None or spec.name not in BUILDERS or spec.name in _ONCE:
            return []
        fields = BUILDERS[spec.name](vehicle.report)
        return [] if fields is None else [(spec.name, *fields)]

    def _capabilities(self, _now_s: float, command: Command) -> Result:
        del command
        self._requested.append(self.vehicle.identity.autopilot_version())
        return Result.ACCEPTED


def mode_entries(flavour: Flavour) -> list[ModeEntry]:
    """The flavour's modes, as AVAILABLE_MODES lists them."""
    return [ModeEntry(mode.name.capitalize(), mode.number) for mode in flavour.modes.modes]


_REQUESTS: Final[dict[int, Callable[[Link, float, Any], Result]]] = {
    _SET_INTERVAL: Link._set_interval,  # noqa: SLF001 - its own methods, by command number
    _GET_INTERVAL: Link._get_interval,  # noqa: SLF001
    _REQUEST_MESSAGE: Link._request,  # noqa: SLF001
    _CAPABILITIES: Link._capabilities,  # noqa: SLF001
}
