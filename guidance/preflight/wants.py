"""What the configuration asks of the autopilot, and what is known of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from guidance.messages import Message
from guidance.preflight.uploaded import Uploaded
from guidance.vehicle import VehicleState


@dataclass(frozen=True, slots=True, kw_only=True)
class Wants:
    """The configuration's side.

    Attributes:
        speed_m_s: Horizontal speed of the game.
        limit_speed_m_s: Horizontal speed that our own limits allow (catching up is a little faster than the game).
        climb_m_s: Climb of the game.
        descent_m_s: Descent of the game.
        fence_required: Whether the autopilot's own fence must stand behind ours.
        fence_radius_m: How far from home our fence lets the vehicle go.
        ceiling_m: How high above home.
        fence_circle_m: Radius of our circle about home, where there is one.
        fence_corners_ne_m: Corners of our polygon, metres north and east of home, where there is one.
        fence_corners_deg: The same by latitude and longitude, as long as home is not known.
        loss_time_limit_s: Longest time that an old setpoint may be flown when ours stop.
        origin_distance_limit_m: Farthest that the local frame's zero may be from home.
        evader_height_limit_m: Largest difference between the evader's altitude and home's.
    """

    speed_m_s: float
    limit_speed_m_s: float
    climb_m_s: float
    descent_m_s: float
    fence_required: bool
    fence_radius_m: float
    ceiling_m: float
    loss_time_limit_s: float = 1.5
    origin_distance_limit_m: float = 1000.0
    evader_height_limit_m: float = 30.0
    fence_circle_m: float | None = None
    fence_corners_ne_m: tuple[tuple[float, float], ...] | None = None
    fence_corners_deg: tuple[tuple[float, float], ...] | None = None


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
