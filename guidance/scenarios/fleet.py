"""The two vehicles of a mocked flight: who they are and where they stand, for either world."""

from dataclasses import dataclass

from guidance.frames import Vector
from guidance.scenarios.model import Scenario

PURSUER_ID, EVADER_ID = 1, 2


@dataclass(frozen=True, slots=True)
class MockSpec:
    """One mock vehicle: its namespace on the wire, flavour, MAVLink system id and where it stands at first.

    `start_ned_m` counts from the site's point; `parameters` differ from the autopilot's defaults.
    """

    name: str
    flavour: str
    system_id: int
    start_ned_m: Vector
    yaw_deg: float
    parameters: dict[str, float]


def mock_specs(scenario: Scenario) -> tuple[MockSpec, MockSpec]:
    """Return the pursuer, on the ground near below its start, and the evader, at its own.

    The pursuer's autopilot is set to the vertical speeds that the scenario says it has.
    """
    x, y, _ = scenario.pursuer.position_m
    limits = {}
    if scenario.pursuer.autopilot == "px4":
        limits = {"MPC_Z_VEL_MAX_UP": scenario.pursuer.climb_m_s, "MPC_Z_VEL_MAX_DN": scenario.pursuer.descent_m_s}
    ex, ey = scenario.evader.position_m
    return (
        MockSpec("pursuer", scenario.pursuer.autopilot, PURSUER_ID, (y - 2.0, x, 0.0), 0.0, limits),
        MockSpec("evader", "rover", EVADER_ID, (ey, ex, -scenario.evader.height_m), 0.0, {}),
    )
