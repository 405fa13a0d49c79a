"""What conditions that happen once do to a vehicle when their time has come (`sitl_mock.conditions`)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from sitl_mock.dynamics import Motion
    from sitl_mock.flavour import Commander
    from sitl_mock.vehicle_state import VehicleState
    from sitl_mock.world import Vector


class Struck(Protocol):
    """The autopilot that something happens to."""

    state: VehicleState
    commander: Commander
    motion: Motion
    time_jump_s: float

    def boot(self, now_s: float) -> None:
        """Begin from nothing."""
        ...


def _switch(autopilot: Struck, now_s: float, mode: str) -> None:
    autopilot.commander.switch(now_s, mode)


def _jump(autopilot: Struck, _now_s: float, by_m: Vector) -> None:
    autopilot.state.estimator.jump(by_m)


def _jump_yaw(autopilot: Struck, _now_s: float, by_deg: float) -> None:
    autopilot.state.estimator.jump_yaw(math.radians(by_deg))


def _set_battery(autopilot: Struck, _now_s: float, share: float) -> None:
    autopilot.state.battery.remaining = share


def _push(autopilot: Struck, _now_s: float, by_m_s: Vector) -> None:
    body = autopilot.motion.body
    n, e, d = body.velocity_ned_m_s
    pushed = body._replace(velocity_ned_m_s=(n + by_m_s[0], e + by_m_s[1], d + by_m_s[2]))
    autopilot.motion = autopilot.motion._replace(body=pushed)


def _reboot(autopilot: Struck, now_s: float, _value: object) -> None:
    autopilot.boot(now_s)


def _jump_time(autopilot: Struck, _now_s: float, by_s: float) -> None:
    autopilot.time_jump_s += by_s


INCIDENTS: Final[dict[str, Callable[[Struck, float, Any], None]]] = {
    "pilot_mode": _switch,
    "ekf_jump_m": _jump,
    "ekf_yaw_jump_deg": _jump_yaw,
    "battery": _set_battery,
    "push_m_s": _push,
    "reboot": _reboot,
    "time_jump_s": _jump_time,
}
