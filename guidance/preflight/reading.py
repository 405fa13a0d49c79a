"""Reads from the autopilot before a flight: its version, parameters, uploaded fence and rates, as `Facts`."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

from guidance.autopilots import Autopilot, Version
from guidance.autopilots.description import AUTOPILOT_VERSION
from guidance.flight.freshness import known
from guidance.messages import (
    AutopilotVersion,
    EvaderReport,
    Heartbeat,
    Message,
    Parameter,
    ParameterRequest,
    Request,
)
from guidance.preflight.fence import Reading, Uploaded
from guidance.preflight.parameters import parameter_names, version_of
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
        return version_of(self._autopilot, self._heard_version)

    def observe(self, messages: Iterable[Message], reports: Iterable[EvaderReport]) -> None:
        """Handle the messages of one cycle. Autopilots announce changed parameters, so the facts stay current."""
        for message in messages:
            if isinstance(message, Heartbeat) and not self._autopilot.speaks(message):
                continue
            self._arrivals.setdefault(type(message), deque(maxlen=512)).append(message.received_s)
            self._fence.observe(message)
            if isinstance(message, Parameter):
                if message.name in self._names:
                    self._parameters[message.name] = message
            elif isinstance(message, AutopilotVersion):
                self._heard_version = message
                self._names = self._named()
                self._asked_s = -math.inf
        for report in reports:
            self._evader = report

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
        """True while the uploaded fence is being downloaded."""
        return not self._fence.over

    @property
    def fence_progress(self) -> str:
        """Progress of the fence's download, in words."""
        return self._fence.progress

    @property
    def fence_known(self) -> bool:
        """True if the uploaded fence was read once, or refused."""
        return self._fence.found != Uploaded()

    @property
    def complete(self) -> bool:
        """True if the version and every parameter were read. The uploaded fence is read separately."""
        return self._heard_version is not None and self.parameters_complete

    @property
    def parameters_complete(self) -> bool:
        """True if every parameter was read."""
        return all(name in self._parameters for name in self._names)

    def settled(self, now_s: float) -> bool:
        """True if everything was read, or if the requests have timed out."""
        if self._begun_s is None:
            return False
        if self.complete and self.fence_known:
            return True
        return now_s - self._begun_s > 2.0 * ASK_AGAIN_S

    @property
    def missing(self) -> tuple[str, ...]:
        """Missing values, in words."""
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
        """Return the facts at `now_s`, without telemetry that is too old.

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
