"""Messages outside the protocols: heartbeats, setpoints, SET_MODE, sticks. Unknown ones are ignored."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sitl_mock.protocols import Place, addressed, is_on_earth
from sitl_mock.vector import Vector
from sitl_mock.vehicle.pilot import (
    OVERRIDE_TIME,
    PITCH,
    ROLL,
    THROTTLE,
    YAW,
    Override,
    Sticks,
    stick_of,
)
from sitl_mock.vehicle.state import Reported

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message
    from sitl_mock.vehicle.flavour import Commander
    from sitl_mock.vehicle.state import VehicleState

COMPONENT: Final = 1
"""MAVLink component id of an autopilot."""

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
_RELEASED_ABOVE_8: Final = 0xFFFE
"""Releases a channel above 8, where 0 means unchanged."""
_STICK_CHANNELS: Final = (ROLL, PITCH, THROTTLE, YAW)
_OVERRIDABLE: Final = 16
_FASTEST_M_S: Final = 1000.0


def take(state: VehicleState, commander: Commander, now_s: float, message: Message) -> None:
    """Take one message; the vehicle's own and those for other systems are ignored.

    Args:
        state: The vehicle.
        commander: Its commander.
        now_s: Present time.
        message: The decoded message.
    """
    if not addressed(message, state.system_id, COMPONENT):
        return
    if message.get_srcSystem() == state.system_id and message.get_srcComponent() == COMPONENT:
        return
    match message.get_type():
        case "HEARTBEAT" if not state.conditions.gcs_lost:
            if GROUND_ID not in state.parameters:
                state.peers.hear(now_s, message.type)
            elif _from_ground(state, message):
                state.peers.hear(now_s, _GROUND_STATION)
        case (
            "SET_POSITION_TARGET_LOCAL_NED"
            | "SET_POSITION_TARGET_GLOBAL_INT"
            | "SET_ATTITUDE_TARGET"
        ):
            commander.offer(now_s, message)
        case "SET_MODE":
            commander.set_mode(now_s, message.base_mode, message.custom_mode)
        case "FOLLOW_TARGET":
            # Regardless of est_capabilities; implausible values are dropped.
            position = Place(message.lat * 1e-7, message.lon * 1e-7, message.alt)
            velocity = Vector(message.vel)
            if is_on_earth(position) and all(abs(value) < _FASTEST_M_S for value in velocity):
                state.target = Reported(now_s, state.frame.to_local(*position), velocity)
        case "MANUAL_CONTROL":
            _manual_control(state, now_s, message)
        case "RC_CHANNELS_OVERRIDE":
            _override(state, now_s, message)


def _from_ground(state: VehicleState, message: Message) -> bool:
    """True if the sender has the system id SYSID_MYGCS (ArduPilot); always true on PX4."""
    return bool(message.get_srcSystem() == state.parameters.get(GROUND_ID, message.get_srcSystem()))


def _manual_control(state: VehicleState, now_s: float, message: Message) -> None:
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
    if max(abs(pitch), abs(roll), abs(throttle), abs(yaw)) > 1.0:
        return
    sticks = Sticks(roll, pitch, 2.0 * throttle - 1.0, yaw)
    if OVERRIDE_TIME not in state.parameters:
        state.pilot.hear(now_s, sticks)
        return
    positions = (sticks.roll, -sticks.pitch, sticks.throttle, sticks.yaw)
    for channel, position in zip(_STICK_CHANNELS, positions, strict=True):
        state.pilot.override(now_s, channel, round(1500.0 + 500.0 * position))


def _override(state: VehicleState, now_s: float, message: Message) -> None:
    """RC_CHANNELS_OVERRIDE: pulse widths; a message with an impossible one is ignored.

    0 releases a channel up to 8, 65535 leaves it unchanged. ArduPilot takes 16 channels, and each expires by itself.
    PX4 has no sticks before the client has given all four.
    """
    source = state.parameters.get(STICK_SOURCE)
    if source == NO_STICKS or state.conditions.rc is False or not _from_ground(state, message):
        return
    pilot = state.pilot
    by_channel = OVERRIDE_TIME in state.parameters
    channels = _OVERRIDABLE if by_channel else 8
    pulses = {}
    for channel in range(1, channels + 1):
        pulse = getattr(message, f"chan{channel}_raw")
        if channel > 8 and pulse == _RELEASED:
            continue
        if channel > 8 and pulse == _RELEASED_ABOVE_8:
            pulse = _RELEASED
        if pulse != _UNCHANGED:
            pulses[channel] = pulse
    if any(
        pulse != _RELEASED and not _PWM_LEAST <= pulse <= _PWM_MOST for pulse in pulses.values()
    ):
        return
    for channel, pulse in pulses.items():
        if pulse == _RELEASED:
            pilot.release(channel)
        elif by_channel:
            pilot.override(now_s, channel, pulse)
        else:
            pilot.channels[channel] = Override(pulse, now_s)
    if by_channel or any(channel not in pilot.channels for channel in _STICK_CHANNELS):
        return
    roll, pitch, throttle, yaw = (
        stick_of(pilot.channels[channel].pulse_us) for channel in _STICK_CHANNELS
    )
    pilot.hear(now_s, Sticks(roll, -pitch, throttle, yaw))
