"""Conditions that faults and tests impose on a vehicle.

A condition has a name and a value and holds until it is changed. Conditions that happen once (mode switches, jumps) are
events; the vehicle handles each one once.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from sitl_mock.errors import ConfigError
from sitl_mock.tables import flag
from sitl_mock.vector import ZERO, Vector


@dataclass(frozen=True)
class ConditionKind:
    """One condition: its meaning, its neutral value, and a function that checks values."""

    meaning: str
    rest: Any
    parse: Callable[[Any], Any]
    event: bool = False


def _number(low: float, high: float) -> Callable[[Any], float]:
    def parse(value: Any) -> float:  # noqa: ANN401 - anything may come from a file
        number = float(value)
        if not low <= number <= high:
            raise ValueError(f"a number from {low:g} to {high:g}")
        return number

    return parse


def _numbers(value: Any, count: int) -> tuple[float, ...]:  # noqa: ANN401 - anything may come from a file
    numbers = tuple(float(item) for item in value)
    if len(numbers) != count:
        raise ValueError(f"{count} numbers")
    return numbers


def _vector(value: Any) -> Vector:  # noqa: ANN401 - anything may come from a file
    north, east, down = _numbers(value, 3)
    return Vector((north, east, down))


CONDITIONS: Mapping[str, ConditionKind] = MappingProxyType(
    {
        "pilot_mode": ConditionKind(
            "the pilot switches to this mode (its name)", "", str, event=True
        ),
        "sticks": ConditionKind(
            "a radio is present with sticks at roll, pitch, throttle, yaw in [-1, 1]",
            (0.0, 0.0, 0.0, 0.0),
            lambda value: _numbers(value, 4),
        ),
        "rc": ConditionKind(
            "a radio is present with centred sticks; false: it is lost", None, flag
        ),
        "gcs_lost": ConditionKind("heartbeats of ground stations are not heard", False, flag),
        "arm_refused": ConditionKind("arming is refused with this reason", "", str),
        "offboard_refused": ConditionKind("OFFBOARD or GUIDED is refused", False, flag),
        "ekf_jump_m": ConditionKind(
            "the position estimate jumps by north, east, down",
            ZERO,
            _vector,
            event=True,
        ),
        "ekf_yaw_jump_deg": ConditionKind(
            "the heading estimate jumps", 0.0, _number(-180.0, 180.0), event=True
        ),
        "gps_lost": ConditionKind("the receiver has no fix", False, flag),
        "eph_m": ConditionKind(
            "horizontal uncertainty grows to at least this", 0.0, _number(0.0, 1e4)
        ),
        "drift_m_s": ConditionKind(
            "the position estimate drifts by north, east, down per second",
            ZERO,
            _vector,
        ),
        "thrust_share": ConditionKind("produced over demanded thrust", 1.0, _number(0.0, 1.0)),
        "estimator_invalid": ConditionKind(
            "position and velocity estimates are invalid", False, flag
        ),
        "fence_breach": ConditionKind("the fence counts as breached", False, flag),
        "battery": ConditionKind("charge left, a fraction", 1.0, _number(0.0, 1.0), event=True),
        "wind_m_s": ConditionKind("wind towards north, east, down", ZERO, _vector),
        "gust_m_s": ConditionKind("gusts of this standard deviation", 0.0, _number(0.0, 30.0)),
        "push_m_s": ConditionKind(
            "the vehicle's velocity jumps by north, east, down",
            ZERO,
            _vector,
            event=True,
        ),
        "telemetry_frozen": ConditionKind("only HEARTBEAT is sent", False, flag),
        "silent": ConditionKind("nothing is sent", False, flag),
        "reboot": ConditionKind(
            "the autopilot restarts, also in flight; its clock restarts", True, flag, event=True
        ),
        "time_jump_s": ConditionKind("time since boot jumps", 0.0, _number(-1e7, 1e7), event=True),
    }
)


def parse(name: str, value: Any) -> Any:  # noqa: ANN401 - anything may come from a file
    """Check one condition.

    Raises:
        ConfigError: The name is unknown, or the value is not one of those allowed.
    """
    kind = CONDITIONS.get(name)
    if kind is None:
        raise ConfigError(f"condition {name!r} is not known; allowed are {', '.join(CONDITIONS)}")
    try:
        return kind.parse(value)
    except (TypeError, ValueError) as error:
        raise ConfigError(
            f"condition {name} = {value!r}: allowed is {error} ({kind.meaning})"
        ) from None


@dataclass(slots=True)
class Conditions:
    """The present conditions of one vehicle, and the events not yet handled."""

    rc: bool | None = None
    sticks: tuple[float, float, float, float] | None = None
    gcs_lost: bool = False
    arm_refused: str = ""
    offboard_refused: bool = False
    gps_lost: bool = False
    eph_m: float = 0.0
    drift_m_s: Vector = ZERO
    thrust_share: float = 1.0
    estimator_invalid: bool = False
    fence_breach: bool = False
    wind_m_s: Vector = ZERO
    gust_m_s: float = 0.0
    telemetry_frozen: bool = False
    silent: bool = False
    events: list[tuple[str, Any]] = field(default_factory=list)

    def put(self, name: str, value: Any) -> None:  # noqa: ANN401 - anything may come from a file
        """Set a condition, or queue an event.

        Raises:
            ConfigError: The name is unknown, or the value is not one of those allowed.
        """
        checked = parse(name, value)
        if CONDITIONS[name].event:
            self.events.append((name, checked))
        else:
            setattr(self, name, checked)

    def take(self) -> list[tuple[str, Any]]:
        """Return the events that came since the last call."""
        events = self.events
        self.events = []
        return events
