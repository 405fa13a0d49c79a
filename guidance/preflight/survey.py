"""Gathers what preflight judges: asks for parameters, counts what arrives, remembers. Time is given, never read."""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from guidance.messages import EvaderReport, Heartbeat, Message, Parameter, ParameterRequest, Request
from guidance.preflight.fence import Reading, Uploaded
from guidance.vehicle import VehicleState

ASK_AGAIN_S: Final = 5.0
"""A link repeats a request four times in two seconds; what is not answered by then is asked for anew after this."""

COUNTED_S: Final = 2.0
"""Rates are counted over this time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """The vehicle's side: parameters and uploaded fence as read, the vehicle as heard, messages per second.

    And the evader's last altitude. `parameter_types` are MAV_PARAM_TYPE.
    """

    parameters: Mapping[str, float] = field(default_factory=dict)
    parameter_types: Mapping[str, int] = field(default_factory=dict)
    vehicle: VehicleState = field(default_factory=VehicleState)
    rates_hz: Mapping[type[Message], float] = field(default_factory=dict)
    evader_amsl_m: float | None = None
    uploaded: Uploaded = field(default_factory=Uploaded)


class PreflightMemory:
    """The memory of one vehicle's preflight."""

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
        """Take in what one cycle heard. Autopilots announce parameters that are changed, so that this stays true."""
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
        """Ask for all parameters that are still missing, every few seconds, and then for the uploaded fence."""
        if not self._heard:
            return ()
        if self.complete:
            return self._fence.requests(now_s)
        if self._asked_s is not None and now_s - self._asked_s < ASK_AGAIN_S:
            return ()
        self._asked_s = now_s
        return tuple(ParameterRequest(name) for name in self._names if name not in self._parameters)

    def forget(self, names: Iterable[str]) -> None:
        """Ask for these once more: they are unknown until they are answered."""
        for name in names:
            self._parameters.pop(name, None)
        self._asked_s = None

    @property
    def complete(self) -> bool:
        """True once every parameter has been read. An autopilot need not have an uploaded fence to tell of."""
        return self._parameters.keys() >= set(self._names)

    @property
    def read(self) -> tuple[int, int]:
        """How many parameters have been read, and how many are wanted."""
        return len(self._parameters), len(set(self._names))

    def facts(self, vehicle: VehicleState, now_s: float) -> Facts:
        """What is known now."""
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
