"""The vehicle as last heard: one frozen record, folded message by message, with the age of everything in it."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

from guidance.frames import Amsl, LocalFrame, Projection
from guidance.telemetry import (
    Attitude,
    CommandAck,
    Heartbeat,
    Home,
    LandedState,
    LocalPosition,
    Message,
    Odometry,
    Origin,
    StatusText,
)

LANDED_ON_GROUND = 1

# A sender's clock that runs backwards by more than this is a reboot; less is reordering.
_REBOOT_S = 1.0

Kind = TypeVar("Kind", bound=Message)


@dataclass(frozen=True, slots=True)
class VehicleState:
    """The latest message of every kind, the estimator's jumps seen in ODOMETRY, and the reboots seen in the clock."""

    latest: Mapping[type, Message] = field(default_factory=dict)
    resets: int = 0
    reboots: int = 0

    def last(self, kind: type[Kind]) -> Kind | None:
        """Return the latest message of a kind, None until one was heard."""
        message = self.latest.get(kind)
        return message if isinstance(message, kind) else None

    def age_s(self, kind: type[Kind], now_s: float) -> float:
        """Seconds since a message of this kind arrived; infinite if none ever did."""
        message = self.latest.get(kind)
        return math.inf if message is None else now_s - message.received_s

    @property
    def armed(self) -> bool:
        """Armed, as the last HEARTBEAT has it."""
        heartbeat = self.last(Heartbeat)
        return heartbeat is not None and heartbeat.armed

    @property
    def yaw_rad(self) -> float:
        """Heading of the last ATTITUDE, radians from north; zero until it was heard."""
        attitude = self.last(Attitude)
        return 0.0 if attitude is None else attitude.yaw_rad

    @property
    def on_ground(self) -> bool:
        """On the ground, as the last EXTENDED_SYS_STATE has it; False until it was heard."""
        landed = self.last(LandedState)
        return landed is not None and landed.landed_state == LANDED_ON_GROUND


def observe(state: VehicleState, messages: Iterable[Message]) -> VehicleState:
    """Fold messages, oldest first, into the state.

    Local positions that are not finite, repeated or older than the one held are passed over.
    """
    latest, resets, reboots = dict(state.latest), state.resets, state.reboots
    for message in messages:
        if isinstance(message, LocalPosition):
            held = latest.get(LocalPosition)
            step_s = message.time_boot_s - held.time_boot_s if isinstance(held, LocalPosition) else math.inf
            if not _finite(message) or -_REBOOT_S <= step_s <= 0.0:
                continue
            reboots += step_s < -_REBOOT_S
        elif isinstance(message, Odometry):
            previous = latest.get(Odometry)
            resets += isinstance(previous, Odometry) and previous.reset_counter != message.reset_counter
        elif isinstance(message, CommandAck | StatusText):
            continue
        latest[type(message)] = message
    return replace(state, latest=latest, resets=resets, reboots=reboots)


def _finite(message: LocalPosition) -> bool:
    return all(map(math.isfinite, (*message.position_ned_m, *message.velocity_ned_m_s)))


def local_frame(state: VehicleState, projection: Projection) -> LocalFrame | None:
    """Return where the vehicle's local frame lies on Earth; None until HOME_POSITION was heard.

    GPS_GLOBAL_ORIGIN is the estimator's word; without it the origin is reckoned from home, which need not be there.
    """
    home, origin = state.last(Home), state.last(Origin)
    if home is None:
        return None
    home_amsl = Amsl(home.altitude_amsl_m)
    if origin is not None:
        return LocalFrame(
            origin.latitude_deg, origin.longitude_deg, Amsl(origin.altitude_amsl_m), home_amsl, projection=projection
        )
    about_home = LocalFrame(home.latitude_deg, home.longitude_deg, home_amsl, projection=projection)
    north_m, east_m, down_m = home.position_ned_m
    latitude_deg, longitude_deg, altitude = about_home.wgs84_from_ned((-north_m, -east_m, -down_m))
    return LocalFrame(latitude_deg, longitude_deg, altitude, home_amsl, projection=projection)
