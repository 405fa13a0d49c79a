"""What a configuration demands of the autopilot, for tests of preflight."""

from guidance.autopilots import Preflight, Wants
from guidance.control import Limits, Speeds


def wants_of(
    *,
    limit_speed_m_s=9.0,
    fence_required=True,
    battery_needed=None,
    announces=False,
    **limits,
):
    """Demand this; `limits` are keys of `[limits]`."""
    given = Limits.model_construct(**{"fence_radius_m": 200.0, "ceiling_m": 60.0, **limits})
    speeds = Speeds(6.0, 2.0, 1.5)
    limit_speeds = speeds._replace(speed_m_s=limit_speed_m_s)
    return Wants(
        Preflight(fence_required=fence_required),
        given,
        speeds,
        limit_speeds,
        battery_needed,
        evader_height_limit_m=30.0,
        announces=announces,
        evader_speed_m_s=0.0,
        standoff_radius_m=0.0,
    )
