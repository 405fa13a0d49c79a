"""Collects the facts of preflight: requests parameters and the uploaded fence, and counts messages."""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from guidance.messages import EvaderReport, Heartbeat, Message, Parameter, ParameterRequest, Request
from guidance.preflight.fence import Reading, Uploaded
from guidance.vehicle import VehicleState

ASK_AGAIN_S: Final = 5.0
"""Period of new requests. The link itself repeats each request four times within two seconds."""

COUNTED_S: Final = 2.0
"""Averaging time of rates."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """Facts about one vehicle.

    Attributes:
        parameters: Parameters that were read.
        parameter_types: Their MAV_PARAM_TYPE.
        vehicle: State from telemetry.
        rates_hz: Rate of each kind of message.
        evader_amsl_m: The evader's last altitude.
        uploaded: The uploaded fence.
    """

    parameters: Mapping[str, float] = field(default_factory=dict)
    parameter_types: Mapping[str, int] = field(default_factory=dict)
    vehicle: VehicleState = field(default_factory=VehicleState)
    rates_hz: Mapping[type[Message], float] = field(default_factory=dict)
    evader_amsl_m: float | None = None
    uploaded: Uploaded = field(default_factory=Uploaded)


class PreflightMemory:
    """Collects the facts of one vehicle."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._parameters: dict[str, float] = {}
        self._types: dict[str, int] = {}
        self._arrivals: dict[type[Message], deque[float]] = {}
        self._asked_s: float | None = None
        self._evader_amsl_m: float | None = None
        self._heard = False
        self._fence = Reading()

    def observe(self, messages: Iterable[Message], reports: Iterable[EvaderReport]) -> None:
        """Handle the messages of one cycle. Autopilots announce changed parameters, so the facts stay current."""
        for message in messages:
            self._heard |= isinstance(message, Heartbeat)
            self._arrivals.setdefault(type(message), deque(maxlen=512)).append(message.received_s)
            self._fence.observe(message)
            if isinstance(message, Parameter) and message.name in self._names:
                self._parameters[message.name] = message.value
                if message.param_type is not None:
                    self._types[message.name] = message.param_type
        for report in reports:
            self._evader_amsl_m = report.altitude_amsl_m

    def requests(self, now_s: float) -> tuple[Request, ...]:
        """Request missing parameters every `ASK_AGAIN_S`, then the uploaded fence."""
        if not self._heard:
            return ()
        if self.complete:
            return self._fence.requests(now_s)
        if self._asked_s is not None and now_s - self._asked_s < ASK_AGAIN_S:
            return ()
        self._asked_s = now_s
        return tuple(ParameterRequest(name) for name in self._names if name not in self._parameters)

    def forget(self, names: Iterable[str]) -> None:
        """Forget these parameters and request them again."""
        for name in names:
            self._parameters.pop(name, None)
        self._asked_s = None

    @property
    def complete(self) -> bool:
        """Whether every parameter was read. The uploaded fence is optional."""
        return self._parameters.keys() >= set(self._names)

    @property
    def read(self) -> tuple[int, int]:
        """Number of parameters read, and of parameters requested."""
        return len(self._parameters), len(set(self._names))

    def facts(self, vehicle: VehicleState, now_s: float) -> Facts:
        """Return the facts at `now_s`."""
        rates_hz = {kind: _rate_hz(times_s, now_s) for kind, times_s in self._arrivals.items()}
        parameters: Mapping[str, float] = dict(self._parameters)
        return Facts(
            parameters=parameters,
            parameter_types=dict(self._types),
            vehicle=vehicle,
            rates_hz=rates_hz,
            evader_amsl_m=self._evader_amsl_m,
            uploaded=self._fence.found,
        )


def _rate_hz(times_s: deque[float], now_s: float) -> float:
    return sum(now_s - time_s <= COUNTED_S for time_s in times_s) / COUNTED_S
