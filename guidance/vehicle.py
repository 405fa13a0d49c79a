"""Plausibility checks of messages, and the vehicle state that they produce.

`is_plausible` refuses NaN, infinities and impossible sizes where a message enters, so that later code need not check.
Its bounds are generous; limits and preflight judge the flight. `observe` folds messages into the vehicle's last known
state, a frozen record with the age of every message.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, NamedTuple, Protocol, TypeVar

from guidance import messages
from guidance.boot_clock import BootClock, elapsed_s, fits_former, with_answer, with_position
from guidance.frames import STILL, Amsl, LocalFrame, Ned, Projection
from guidance.messages import (
    GlobalPosition,
    Heartbeat,
    Home,
    LocalPosition,
    Message,
    Odometry,
    Origin,
)

LANDED_ON_GROUND = 1
_IN_AIR = frozenset({2, 3, 4})
"""MAV_LANDED_STATE: in the air, taking off, landing; 0 is unknown."""

# A step of the sender's clock backwards beyond this is a reboot; a smaller one is reordering. After 24.8 days of
# uptime a step back to zero looks like a step forward, and no link is a day late.
_REBOOT_S = 1.0
_DAY_S = 86_400.0

# Largest mismatch of positions and velocities (0.03 m on PX4 and ArduCopter), plus the effect of a manoeuvre between
# two messages. A larger mismatch is a jump of the estimate.
_ASTRAY_M = 1.0
_ASTRAY_M_S2 = 2.5

_CONTRADICTIONS = 3
_CONTRADICTED_WITHIN_S = 2.0
"""So many positions that contradict the last one, in so short a time, come from a second sender."""

_SMOOTHED_S = 0.1
_GAP_S = 0.5

FARTHEST_M: Final = 1e6
"""Largest local coordinate or radius. Single precision, as in PX4 and ArduPilot, resolves 0.1 m there."""

HIGHEST_M: Final = 1e5
FASTEST_M_S: Final = 1e3
_TURNED_RAD: Final = 4.0 * math.pi
_LATEST_S: Final = 2.0**32 / 1e3  # time_boot_ms has 32 bits

Kind = TypeVar("Kind", bound=Message)


class Latest(Protocol):
    """The latest message of every kind, by its type."""

    def get(self, kind: type[Kind], /) -> Kind | None:
        """Return the latest message of a kind; None before the first one."""

    def copy(self) -> dict[type, Any]:
        """Return them all."""


class VehicleState(NamedTuple):
    """Last known state of a vehicle.

    Attributes:
        latest: The latest message of every kind; of HOME_POSITION the last one before home was fixed.
        home_fixed: Whether home is fixed. Whoever accepts a flight fixes it, and later homes are not used.
        home_refused: The last HOME_POSITION after that.
        resets: Number of estimator resets: ODOMETRY counts one, or LOCAL_POSITION_NED jumps.
        reset_s: Time of the last reset.
        jumped_ned_m: The sum of all jumps.
        jumped_boot_s: Time of the last jump, on the sender's clock; NaN before the first one.
        reboots: Number of restarts of the sender's clock.
        acceleration_ned_m_s2: Acceleration, smoothed over about 0.1 s.
        clock: The vehicle's clock, and how late its telemetry is.
        jump_ned_m: The last jump.
        contradicted_s: Times of the latest positions that only a second sender explains.
    """

    latest: Latest = MappingProxyType[type, Any]({})
    home_fixed: bool = False
    home_refused: Home | None = None
    resets: int = 0
    reset_s: float = -math.inf
    jumped_ned_m: Ned = STILL
    jumped_boot_s: float = math.nan
    reboots: int = 0
    acceleration_ned_m_s2: Ned = STILL
    clock: BootClock = BootClock()
    jump_ned_m: Ned = STILL
    contradicted_s: tuple[float, ...] = ()

    def has_second_sender(self, now_s: float) -> bool:
        """True if the positions of the last seconds jump between two senders."""
        times_s = self.contradicted_s
        return (
            len(times_s) == _CONTRADICTIONS and now_s - times_s[0] <= 2.0 * _CONTRADICTED_WITHIN_S
        )

    @property
    def delay_s(self) -> float:
        """Largest age of the last position when it arrived; 0 while the vehicle's clock is unknown."""
        delay_s = self.clock.delay_s
        return 0.0 if math.isnan(delay_s) else delay_s

    def age_s(self, kind: type[Kind], now_s: float) -> float:
        """Seconds since a message of this kind was measured: since it arrived, and the delay of the link.

        Infinite if none ever arrived.
        """
        message = self.latest.get(kind)
        if message is None:
            return math.inf
        silence_s = now_s - message.received_s
        delay_s = self.clock.delay_s
        return silence_s if math.isnan(delay_s) else silence_s + delay_s

    def silence_s(self, kind: type[Kind], now_s: float) -> float:
        """Seconds since a message of this kind arrived; infinite if none ever did."""
        message = self.latest.get(kind)
        return math.inf if message is None else now_s - message.received_s

    @property
    def armed(self) -> bool:
        """True if the last HEARTBEAT says armed; False before the first one."""
        beat = self.latest.get(Heartbeat)
        return beat is not None and beat.armed

    @property
    def yaw_rad(self) -> float:
        """Heading in the last ATTITUDE, from north; zero before the first one."""
        attitude = self.latest.get(messages.Attitude)
        return 0.0 if attitude is None else attitude.yaw_rad

    @property
    def on_ground(self) -> bool:
        """True if the last EXTENDED_SYS_STATE says on ground; False before the first one."""
        landed = self.latest.get(messages.LandedState)
        return landed is not None and landed.landed_state == LANDED_ON_GROUND

    @property
    def in_air(self) -> bool:
        """True if the last EXTENDED_SYS_STATE says in the air, taking off or landing; False before the first one."""
        landed = self.latest.get(messages.LandedState)
        return landed is not None and landed.landed_state in _IN_AIR


def observe(state: VehicleState, arrived: Sequence[Message]) -> VehicleState:
    """Fold messages, oldest first, into the state.

    The messages must be plausible, as links deliver them. Local positions that are not newer than the last one are
    ignored. So is a home reported after home was fixed: PX4 moves it by up to 2 m every two seconds, an operator may
    set it anywhere, and heights and fences refer to the home at the flight's acceptance.
    """
    if not arrived:
        return state
    latest = state.latest.copy()  # states that the caller holds do not change
    observed = VehicleState(latest, *state[1:])
    for message in arrived:
        change = _CHANGES.get(type(message))
        if isinstance(message, Home) and observed.home_fixed:
            observed = observed._replace(home_refused=message)
            continue
        changed = observed if change is None else change(message, observed)
        if changed is not None:
            observed = changed
            latest[type(message)] = message
        elif isinstance(message, LocalPosition) and _contradicts(message, observed):
            observed = _contradicted(message, observed)
    return observed


def _changed_by_odometry(now: Odometry, state: VehicleState) -> VehicleState:
    previous = state.latest.get(Odometry)
    if previous is None or previous.reset_counter == now.reset_counter:
        return state
    return state._replace(resets=state.resets + 1, reset_s=now.received_s)


def _changed_by_position(now: LocalPosition, state: VehicleState) -> VehicleState | None:
    """A position shows a jump or a reboot; it is ignored if it is not new."""
    previous = state.latest.get(LocalPosition)
    clock = with_position(state.clock, now.received_s, now.time_boot_s)
    if previous is None:
        return state._replace(clock=clock)
    step_s = elapsed_s(previous.time_boot_s, now.time_boot_s)
    restarted = step_s < -_REBOOT_S or step_s > now.received_s - previous.received_s + _DAY_S
    if restarted and not fits_former(state.clock, now.received_s, now.time_boot_s):
        return state._replace(reboots=state.reboots + 1, clock=BootClock())
    if step_s <= 0.0:
        return None
    # The velocities of two positions show the acceleration, low-pass filtered; zero after a gap.
    acceleration_ned_m_s2 = STILL
    if step_s <= _GAP_S:
        present = (now.velocity_ned_m_s - previous.velocity_ned_m_s) / step_s
        share = min(1.0, step_s / _SMOOTHED_S)
        smoothed = state.acceleration_ned_m_s2
        acceleration_ned_m_s2 = smoothed + (present - smoothed) * share
    state = state._replace(acceleration_ned_m_s2=acceleration_ned_m_s2, clock=clock)
    # A movement that neither the velocities nor a manoeuvre explain is a jump.
    way = now.position_ned_m - previous.position_ned_m
    jump = way - 0.5 * step_s * (previous.velocity_ned_m_s + now.velocity_ned_m_s)
    if not math.hypot(*jump) > _ASTRAY_M + _ASTRAY_M_S2 * step_s * step_s:
        return state
    back_m = (state.jump_ned_m + jump).length()
    if now.received_s - state.reset_s <= _CONTRADICTED_WITHIN_S and back_m <= _ASTRAY_M:
        state = _contradicted(now, state)  # to and fro
    return state._replace(
        resets=state.resets + 1,
        reset_s=now.received_s,
        jumped_ned_m=state.jumped_ned_m + jump,
        jumped_boot_s=now.time_boot_s,
        jump_ned_m=jump,
    )


def _contradicts(now: LocalPosition, state: VehicleState) -> bool:
    """True if a position that came after a newer one is not on the way to it, or the newer one has another clock."""
    previous = state.latest.get(LocalPosition)
    if previous is None:
        return False
    if fits_former(state.clock, now.received_s, now.time_boot_s):
        return True
    if elapsed_s(state.jumped_boot_s, now.time_boot_s) < 0.0:
        return False  # older than a jump of the estimate
    step_s = elapsed_s(now.time_boot_s, previous.time_boot_s)
    steps = zip(previous.position_ned_m, now.position_ned_m, previous.velocity_ned_m_s, strict=True)
    apart_m = math.hypot(*(to - at - step_s * rate for to, at, rate in steps))
    return apart_m > _ASTRAY_M + _ASTRAY_M_S2 * step_s


def _contradicted(now: LocalPosition, state: VehicleState) -> VehicleState:
    recent_s = [
        at_s for at_s in state.contradicted_s if now.received_s - at_s <= _CONTRADICTED_WITHIN_S
    ]
    times_s = (*recent_s, now.received_s)[-_CONTRADICTIONS:]
    return state._replace(contradicted_s=times_s)


_CHANGES: Final[Mapping[type, Callable[[Any, VehicleState], VehicleState | None]]] = {
    LocalPosition: _changed_by_position,
    Odometry: _changed_by_odometry,
    messages.Timesync: lambda answer, state: state._replace(clock=with_answer(state.clock, answer)),
    messages.CommandAck: lambda _message, _state: None,
    messages.StatusText: lambda _message, _state: None,
}
"""The state after messages that change more than the last message of their kind; None if the message is ignored."""


def local_frame(state: VehicleState, projection: Projection) -> LocalFrame | None:
    """Return the vehicle's local frame; None before HOME_POSITION.

    The origin is GPS_GLOBAL_ORIGIN, or else computed from home. An origin far from home (two vehicles with one system
    id, for example) is not accepted: None.
    """
    home = state.latest.get(Home)
    origin = state.latest.get(Origin)
    if home is None:
        return None
    home_amsl = Amsl(home.altitude_amsl_m)
    if origin is not None:
        reference = (origin.latitude_deg, origin.longitude_deg, Amsl(origin.altitude_amsl_m))
        frame = LocalFrame(*reference, home_amsl, projection=projection)
        away = frame.ned_from_wgs84(home.latitude_deg, home.longitude_deg, home_amsl)
        return frame if math.hypot(*away) <= FARTHEST_M else None
    if not all(map(math.isfinite, home.position_ned_m)):
        return None
    about_home = LocalFrame(home.latitude_deg, home.longitude_deg, home_amsl, projection=projection)
    origin_ned_m = -1.0 * home.position_ned_m
    latitude_deg, longitude_deg, altitude = about_home.wgs84_from_ned(origin_ned_m)
    if abs(latitude_deg) >= 90.0:
        return None
    return LocalFrame(latitude_deg, longitude_deg, altitude, home_amsl, projection=projection)


def is_plausible(message: Message | messages.EvaderReport) -> bool:
    """True if all values of a message are plausible. Values that MAVLink defines as unknown (NaN) are allowed."""
    match message:
        case LocalPosition():
            (north, east, down) = message.position_ned_m
            is_near = (
                abs(north) <= FARTHEST_M and abs(east) <= FARTHEST_M and abs(down) <= FARTHEST_M
            )
            (v_north, v_east, v_down) = message.velocity_ned_m_s
            is_slow = (
                abs(v_north) <= FASTEST_M_S
                and abs(v_east) <= FASTEST_M_S
                and abs(v_down) <= FASTEST_M_S
            )
            plausible = is_near and is_slow and 0.0 <= message.time_boot_s <= _LATEST_S
        case GlobalPosition():
            is_low = abs(message.altitude_above_home_m) <= HIGHEST_M
            is_slow = _within(FASTEST_M_S, *message.velocity_ned_m_s)
            is_in_range = 0.0 <= message.time_boot_s <= _LATEST_S
            plausible = _on_earth(message) and is_low and is_slow and is_in_range
        case messages.Attitude():
            plausible = abs(message.yaw_rad) <= _TURNED_RAD
        case messages.PositionTarget():
            (north, east, down) = message.velocity_ned_m_s
            is_fast = abs(north) > FASTEST_M_S or abs(east) > FASTEST_M_S or abs(down) > FASTEST_M_S
            plausible = not is_fast
        case Home():
            # An unknown local position is computed from the map.
            is_unknown = all(map(math.isnan, message.position_ned_m))
            plausible = _on_earth(message) and (
                is_unknown or _within(FARTHEST_M, *message.position_ned_m)
            )
        case Origin() | messages.EvaderReport():
            plausible = _on_earth(message)
        case messages.Aircraft():
            is_high = abs(message.altitude_amsl_m) > HIGHEST_M
            is_fast = math.hypot(*message.velocity_ned_m_s) > FASTEST_M_S
            plausible = _on_the_map(message) and not is_high and not is_fast
        case messages.SystemStatus():
            plausible = not (message.battery_remaining < 0.0 or message.battery_remaining > 1.0)
        case messages.EstimatorStatus():
            is_unknown = math.isnan(message.height_sd_m)
            plausible = is_unknown or 0.0 <= message.height_sd_m <= HIGHEST_M
        case messages.FenceItem():
            plausible = abs(message.size) <= FARTHEST_M and abs(message.latitude_deg) < 90.0
        case messages.Parameter():
            plausible = math.isfinite(message.value)
        case _:
            plausible = True
    return plausible


def _within(limit: float, *numbers: float) -> bool:
    return all(abs(number) <= limit for number in numbers)


def _on_earth(position: GlobalPosition | Home | Origin | messages.EvaderReport) -> bool:
    return _on_the_map(position) and abs(position.altitude_amsl_m) <= HIGHEST_M


def _on_the_map(
    position: GlobalPosition | Home | Origin | messages.EvaderReport | messages.Aircraft,
) -> bool:
    # North has no direction at a pole
    return abs(position.latitude_deg) < 90.0 and abs(position.longitude_deg) <= 180.0
