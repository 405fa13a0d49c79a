"""Handlers of the conditions that are events (`sitl_mock.vehicle.conditions`)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from sitl_mock.dynamics import Motion
    from sitl_mock.vector import Vector
    from sitl_mock.vehicle.flavour import Commander
    from sitl_mock.vehicle.state import VehicleState


class EventTarget(Protocol):
    """The parts of an autopilot that events change."""

    state: VehicleState
    commander: Commander
    motion: Motion
    time_jump_s: float

    def boot(self, now_s: float) -> None:
        """Restart the autopilot."""
        ...


def _switch(autopilot: EventTarget, now_s: float, mode: str) -> None:
    autopilot.commander.switch(now_s, mode)


def _jump(autopilot: EventTarget, _now_s: float, by_m: Vector) -> None:
    autopilot.state.estimator.jump(by_m)


def _jump_yaw(autopilot: EventTarget, _now_s: float, by_deg: float) -> None:
    autopilot.state.estimator.jump_yaw(math.radians(by_deg))


def _set_battery(autopilot: EventTarget, _now_s: float, share: float) -> None:
    autopilot.state.battery.put(share)


def _push(autopilot: EventTarget, _now_s: float, by_m_s: Vector) -> None:
    body = autopilot.motion.body
    pushed = body._replace(velocity_ned_m_s=body.velocity_ned_m_s + by_m_s)
    autopilot.motion = autopilot.motion._replace(body=pushed)


def _reboot(autopilot: EventTarget, now_s: float, _value: object) -> None:
    autopilot.boot(now_s)


def _jump_time(autopilot: EventTarget, _now_s: float, by_s: float) -> None:
    autopilot.time_jump_s += by_s


INCIDENTS: Final[dict[str, Callable[[EventTarget, float, Any], None]]] = {
    "pilot_mode": _switch,
    "ekf_jump_m": _jump,
    "ekf_yaw_jump_deg": _jump_yaw,
    "battery": _set_battery,
    "push_m_s": _push,
    "reboot": _reboot,
    "time_jump_s": _jump_time,
}
