"""Messages outside the protocols: heartbeats, setpoints, SET_MODE, sticks. Unknown ones are ignored."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sitl_mock.pilot import Sticks
from sitl_mock.protocols import Place, addressed, on_earth
from sitl_mock.vehicle_state import Reported

if TYPE_CHECKING:
    from collections.abc import Callable

    from sitl_mock.flavour import Commander
    from sitl_mock.mavlink import Message
    from sitl_mock.vehicle_state import VehicleState

COMPONENT: Final = 1
STICK_SOURCE: Final = "COM_RC_IN_MODE"
GROUND_ID: Final = "SYSID_MYGCS"
_GROUND_STATION: Final = 6  # MAV_TYPE_GCS
RADIO_ONLY = 0
BOTH = 3
NO_STICKS = 4
_PWM_LEAST = 800
_PWM_MOST = 2200
_RELEASED = 0
_UNCHANGED = 0xFFFF
_STICKS_AT_REST: Final = {1: 1500, 2: 1500, 3: 1000, 4: 1500}
"""Pulse widths of channels that are not overridden in ArduPilot's simulator; PX4 needs all four from the client."""
_FASTEST_M_S: Final = 1000.0


def take(state: VehicleState, commander: Commander, now_s: float, message: Message) -> None:
    """Take one message; the vehicle's own and those for other systems are ignored.

    Args:
        state: The vehicle.
        commander: Its commander.
        now_s: Present time.
        message: The decoded message.
    """
    handler = _HANDLERS.get(message.get_type())
    if handler is None or not addressed(message, state.system_id, COMPONENT):
        return
    if message.get_srcSystem() == state.system_id and message.get_srcComponent() == COMPONENT:
        return
    handler(state, commander, now_s, message)


def _from_ground(state: VehicleState, message: Message) -> bool:
    """True if the sender has the system id SYSID_MYGCS (ArduPilot); always true on PX4."""
    return bool(message.get_srcSystem() == state.parameters.get(GROUND_ID, message.get_srcSystem()))


def _heartbeat(state: VehicleState, _commander: Commander, now_s: float, message: Message) -> None:
    if state.conditions.gcs_lost:
        return
    if GROUND_ID not in state.parameters:
        state.peers.hear(now_s, message.type)
    elif _from_ground(state, message):
        state.peers.hear(now_s, _GROUND_STATION)


def _setpoint(_state: VehicleState, commander: Commander, now_s: float, message: Message) -> None:
    commander.offer(now_s, message)


def _set_mode(_state: VehicleState, commander: Commander, now_s: float, message: Message) -> None:
    commander.set_mode(now_s, message.base_mode, message.custom_mode)


def _manual_control(
    state: VehicleState, _commander: Commander, now_s: float, message: Message
) -> None:
    """MANUAL_CONTROL: pitch x, roll y, yaw r in [-1000, 1000], throttle z in [0, 1000]."""
    source = state.parameters.get(STICK_SOURCE, BOTH)
    if (
        message.target != state.system_id
        or state.conditions.rc is False
        or source in {RADIO_ONLY, NO_STICKS}
    ):
        return
    if not _from_ground(state, message):
        return
    pitch, roll, throttle, yaw = (
        value / 1000.0 for value in (message.x, message.y, message.z, message.r)
    )
    if max(abs(pitch), abs(roll), abs(throttle), abs(yaw)) <= 1.0:
        state.pilot.hear(now_s, Sticks(roll, pitch, 2.0 * throttle - 1.0, yaw))


def _override(state: VehicleState, _commander: Commander, now_s: float, message: Message) -> None:
    """RC_CHANNELS_OVERRIDE: pulse widths of channels 1 to 8; 0 releases a channel, 65535 leaves it unchanged."""
    source = state.parameters.get(STICK_SOURCE)
    if source == NO_STICKS or state.conditions.rc is False or not _from_ground(state, message):
        return
    raw = {number: getattr(message, f"chan{number}_raw") for number in range(1, 9)}
    if any(
        value not in {_RELEASED, _UNCHANGED} and not _PWM_LEAST <= value <= _PWM_MOST
        for value in raw.values()
    ):
        return
    channels = state.pilot.channels
    channels.update((number, value) for number, value in raw.items() if value != _UNCHANGED)
    for number in [number for number, value in channels.items() if value == _RELEASED]:
        del channels[number]
    if source is not None and not channels.keys() >= _STICKS_AT_REST.keys():
        return
    pulses = (channels.get(number, rest) for number, rest in _STICKS_AT_REST.items())
    roll, pitch, throttle, yaw = (min(max((value - 1500) / 500.0, -1.0), 1.0) for value in pulses)
    state.pilot.hear(now_s, Sticks(roll, -pitch, throttle, yaw))


def _follow_target(
    state: VehicleState, _commander: Commander, now_s: float, message: Message
) -> None:
    """FOLLOW_TARGET: position and velocity, regardless of est_capabilities; implausible values are dropped."""
    place = Place(message.lat * 1e-7, message.lon * 1e-7, message.alt)
    velocity = tuple(message.vel)
    if on_earth(place) and all(abs(value) < _FASTEST_M_S for value in velocity):
        state.target = Reported(
            now_s, state.frame.to_local(*place), (velocity[0], velocity[1], velocity[2])
        )


_HANDLERS: Final[dict[str, Callable[[VehicleState, Commander, float, Message], None]]] = {
    "HEARTBEAT": _heartbeat,
    "SET_POSITION_TARGET_LOCAL_NED": _setpoint,
    "SET_POSITION_TARGET_GLOBAL_INT": _setpoint,
    "SET_ATTITUDE_TARGET": _setpoint,
    "SET_MODE": _set_mode,
    "FOLLOW_TARGET": _follow_target,
    "MANUAL_CONTROL": _manual_control,
    "RC_CHANNELS_OVERRIDE": _override,
}
