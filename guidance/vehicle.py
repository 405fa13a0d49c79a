"""What is heard of a vehicle: what of it can be meant, and what it comes to.

`is_plausible` is asked where a message enters, so that nothing behind it has to: NaN, infinities and sizes that nothing
in flight can have are refused. Its bounds are generous: they keep arithmetic whole and nonsense out, and judge no
flight; that is for the limits and for preflight. `observe` folds messages one by one into the vehicle as last heard, a
frozen record with the age of everything in it.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any, Final, NamedTuple, TypeVar

from guidance.frames import Amsl, LocalFrame, Projection, Vector
from guidance.messages import (
    Attitude,
    CommandAck,
    EvaderReport,
    FenceItem,
    GlobalPosition,
    Heartbeat,
    Home,
    LandedState,
    LocalPosition,
    Message,
    Odometry,
    Origin,
    Parameter,
    PositionTarget,
    StatusText,
    SystemStatus,
)

LANDED_ON_GROUND = 1

# A sender's clock that runs backwards by more than this is a reboot; less is reordering.
_REBOOT_S = 1.0

# How far positions may go astray of the velocities told with them (PX4 and ArduCopter in flight: 0.03 m), plus what a
# manoeuvre between two messages makes of that: more is the estimator's doing.
_ASTRAY_M = 1.0
_ASTRAY_M_S2 = 2.5

_SMOOTHED_S = 0.1
_GAP_S = 0.5

# Where a vehicle that arms has its home: here, or its home is still that of another place.
_HERE_M = 2.0

FARTHEST_M: Final = 1e6
"""From the zero of a local frame, or a radius. PX4 and ArduPilot keep local positions in 32 bit, 0.1 m there."""

HIGHEST_M: Final = 1e5
FASTEST_M_S: Final = 1e3
_TURNED_RAD: Final = 4.0 * math.pi
_LATEST_S: Final = 2.0**32 / 1e3  # time_boot_ms has 32 bits

Kind = TypeVar("Kind", bound=Message)


class VehicleState(NamedTuple):
    """What was heard of a vehicle.

    Attributes:
        latest: The latest message of every kind; HOME_POSITION only as the flight has it (see `observe`).
        armed: As the last HEARTBEAT has it.
        yaw_rad: Heading of the last ATTITUDE, from north; zero until it was heard.
        home_taken: Whether home is the flight's: from arming to disarming it stays where it was.
        resets: Signs of an estimator's reset: ODOMETRY counts one, or LOCAL_POSITION_NED jumps.
        reset_s: When the last one was heard.
        jumped_ned_m: The sum of all jumps.
        jumped_boot_s: When the last jump was, on the sender's clock.
        reboots: How often the sender's clock began anew.
        acceleration_ned_m_s2: How its velocity changes, of the last tenth of a second or so.
    """

    latest: Mapping[type, Message] = MappingProxyType({})
    armed: bool = False
    yaw_rad: float = 0.0
    home_taken: bool = False
    resets: int = 0
    reset_s: float = -math.inf
    jumped_ned_m: Vector = (0.0, 0.0, 0.0)
    jumped_boot_s: float = -math.inf
    reboots: int = 0
    acceleration_ned_m_s2: Vector = (0.0, 0.0, 0.0)

    def last(self, kind: type[Kind]) -> Kind | None:
        """Return the latest message of a kind, None until one was heard."""
        message = self.latest.get(kind)
        return message if isinstance(message, kind) else None

    def age_s(self, kind: type[Kind], now_s: float) -> float:
        """Seconds since a message of this kind arrived; infinite if none ever did."""
        message = self.latest.get(kind)
        return math.inf if message is None else now_s - message.received_s

    @property
    def on_ground(self) -> bool:
        """On the ground, as the last EXTENDED_SYS_STATE has it; False until it was heard."""
        landed = self.last(LandedState)
        return landed is not None and landed.landed_state == LANDED_ON_GROUND


def observe(state: VehicleState, messages: Iterable[Message]) -> VehicleState:
    """Fold messages, oldest first, into the state.

    The messages must be plausible, as links deliver them. Local positions that are repeated or older than the one held
    are passed over. So is a home that comes in flight: an autopilot may move it about (PX4, by up to 2 m every two
    seconds), and heights and fences are counted from where it was when the vehicle armed.
    """
    for message in messages:
        changed = _told_by(message, state)
        if changed is not None:
            state = state._replace(latest={**state.latest, type(message): message}, **changed)
    return state


def _told_by(message: Message, state: VehicleState) -> dict[str, Any] | None:
    """Return which fields of the state a message changes, besides being the latest; None if it is passed over."""
    changed: dict[str, Any] | None = {}
    match message:
        case LocalPosition():
            changed = _told_by_position(message, state)
        case Attitude():
            changed = {"yaw_rad": message.yaw_rad}
        case Home():
            changed = None if state.home_taken and state.armed else {"home_taken": state.armed}
        case Odometry(received_s, counter):
            held = state.last(Odometry)
            if held is not None and held.reset_counter != counter:
                changed = {"resets": state.resets + 1, "reset_s": received_s}
        case Heartbeat():
            taken = message.armed and (state.home_taken or _home_is_here(state, message))
            changed = {"armed": message.armed, "home_taken": taken}
        case CommandAck() | StatusText():
            changed = None
    return changed


def _home_is_here(state: VehicleState, now: Heartbeat) -> bool:
    """Whether the home held is that of a vehicle that has just armed, or that we join armed."""
    home, local = state.last(Home), state.last(LocalPosition)
    if Heartbeat not in state.latest:
        return home is not None  # joined in flight: there is no better one than the first
    if state.armed or not now.armed or home is None or local is None:
        return False
    return math.dist(home.position_ned_m, local.position_ned_m) <= _HERE_M


def _told_by_position(now: LocalPosition, state: VehicleState) -> dict[str, Any] | None:
    """Return what a position changes, the jump or the reboot that it shows; None if it is no news."""
    held = state.last(LocalPosition)
    if held is None:
        return {}
    step_s = now.time_boot_s - held.time_boot_s
    if -_REBOOT_S <= step_s <= 0.0:
        return None
    if step_s < 0.0:
        return {"reboots": state.reboots + 1}
    changed: dict[str, Any] = {"acceleration_ned_m_s2": _smoothed(state.acceleration_ned_m_s2, held, now, step_s)}
    jump = _jump_ned_m(held, now, step_s)
    if jump is not None:
        north, east, down = (total + part for total, part in zip(state.jumped_ned_m, jump, strict=True))
        changed |= {
            "resets": state.resets + 1,
            "reset_s": now.received_s,
            "jumped_ned_m": (north, east, down),
            "jumped_boot_s": now.time_boot_s,
        }
    return changed


def _smoothed(before_m_s2: Vector, held: LocalPosition, now: LocalPosition, step_s: float) -> Vector:
    """The acceleration with one more velocity, `step_s` after the last; after a gap it is not known, and none."""
    if step_s > _GAP_S:
        return (0.0, 0.0, 0.0)
    share = min(1.0, step_s / _SMOOTHED_S)
    rows = zip(before_m_s2, held.velocity_ned_m_s, now.velocity_ned_m_s, strict=True)
    north, east, down = (before + share * ((to - was) / step_s - before) for before, was, to in rows)
    return (north, east, down)


def _jump_ned_m(before: LocalPosition, now: LocalPosition, step_s: float) -> Vector | None:
    """How far the position moved beyond what the velocities explain; None for no more than a manoeuvre does."""
    rows = zip(before.position_ned_m, now.position_ned_m, before.velocity_ned_m_s, now.velocity_ned_m_s, strict=True)
    north, east, down = (to - origin - 0.5 * step_s * (was + rate) for origin, to, was, rate in rows)
    allowed_m = _ASTRAY_M + _ASTRAY_M_S2 * step_s * step_s
    return (north, east, down) if math.hypot(north, east, down) > allowed_m else None


def local_frame(state: VehicleState, projection: Projection) -> LocalFrame | None:
    """Return where the vehicle's local frame lies on Earth; None until HOME_POSITION was heard.

    GPS_GLOBAL_ORIGIN is the estimator's word; without it the origin is reckoned from home, which need not be there. An
    origin on another continent than home (two vehicles with one system id, say) is nobody's word: None.
    """
    home, origin = state.last(Home), state.last(Origin)
    if home is None:
        return None
    home_amsl = Amsl(home.altitude_amsl_m)
    if origin is not None:
        frame = LocalFrame(
            origin.latitude_deg, origin.longitude_deg, Amsl(origin.altitude_amsl_m), home_amsl, projection=projection
        )
        away = frame.ned_from_wgs84(home.latitude_deg, home.longitude_deg, home_amsl)
        return frame if math.hypot(*away) <= FARTHEST_M else None
    if not all(map(math.isfinite, home.position_ned_m)):
        return None
    about_home = LocalFrame(home.latitude_deg, home.longitude_deg, home_amsl, projection=projection)
    north_m, east_m, down_m = home.position_ned_m
    latitude_deg, longitude_deg, altitude = about_home.wgs84_from_ned((-north_m, -east_m, -down_m))
    if abs(latitude_deg) >= 90.0:
        return None
    return LocalFrame(latitude_deg, longitude_deg, altitude, home_amsl, projection=projection)


def is_plausible(message: Message | EvaderReport) -> bool:
    """Whether everything in a message can be meant. What may be unknown by its definition (NaN) may be here too."""
    judge = _JUDGES.get(type(message))
    return judge is None or judge(message)


def _within(limit: float, *numbers: float) -> bool:
    return all(abs(number) <= limit for number in numbers)


def _on_earth(place: GlobalPosition | Home | Origin | EvaderReport) -> bool:
    here = abs(place.latitude_deg) < 90.0 and abs(place.longitude_deg) <= 180.0  # at a pole north has no direction
    return here and abs(place.altitude_amsl_m) <= HIGHEST_M


def _home(home: Home) -> bool:
    untold = all(map(math.isnan, home.position_ned_m))  # then it is reckoned from the map
    return _on_earth(home) and (untold or _within(FARTHEST_M, *home.position_ned_m))


def _local(local: LocalPosition) -> bool:
    (north, east, down), (v_north, v_east, v_down) = local.position_ned_m, local.velocity_ned_m_s
    place = abs(north) <= FARTHEST_M and abs(east) <= FARTHEST_M and abs(down) <= FARTHEST_M
    rate = abs(v_north) <= FASTEST_M_S and abs(v_east) <= FASTEST_M_S and abs(v_down) <= FASTEST_M_S
    return place and rate and 0.0 <= local.time_boot_s <= _LATEST_S


def _global(place: GlobalPosition) -> bool:
    height, rate = abs(place.altitude_above_home_m) <= HIGHEST_M, _within(FASTEST_M_S, *place.velocity_ned_m_s)
    return _on_earth(place) and height and rate and 0.0 <= place.time_boot_s <= _LATEST_S


def _status(status: SystemStatus) -> bool:
    return math.isnan(status.battery_remaining) or 0.0 <= status.battery_remaining <= 1.0


def _echo(echo: PositionTarget) -> bool:
    return all(math.isnan(part) or abs(part) <= FASTEST_M_S for part in echo.velocity_ned_m_s)


_JUDGES: Final[Mapping[type, Callable[[Any], bool]]] = {
    Attitude: lambda attitude: abs(attitude.yaw_rad) <= _TURNED_RAD,
    FenceItem: lambda item: abs(item.size) <= FARTHEST_M and abs(item.latitude_deg) < 90.0,
    GlobalPosition: _global,
    Home: _home,
    LocalPosition: _local,
    Origin: _on_earth,
    Parameter: lambda parameter: math.isfinite(parameter.value),
    PositionTarget: _echo,
    SystemStatus: _status,
    EvaderReport: _on_earth,
}
