"""The two mock vehicles of a flight, as the mock's own configuration: one text for both worlds."""

from typing import Final

from guidance.sim.scenario import Scenario

PURSUER, EVADER = "pursuer", "evader"
PURSUER_ID, EVADER_ID = 1, 2

READY_AFTER_S: Final = 3.0
"""The mocks' boot is cut short (a real ArduCopter takes 39 s): nobody learns from watching it."""


def fleet_toml(scenario: Scenario) -> str:
    """Return the fleet: the pursuer on the ground near below its start, and the evader at its own.

    The pursuer's autopilot is set to the vertical speeds that the scenario says it has.
    """
    site, pursuer, evader = scenario.site, scenario.pursuer, scenario.evader
    home_x, home_y = scenario.home_m
    ex, ey = evader.position_m
    limits = ""
    if pursuer.autopilot == "px4":
        limits = (
            "[vehicle.parameters]\n"
            f"MPC_Z_VEL_MAX_UP = {float(pursuer.climb_m_s)!r}\n"
            f"MPC_Z_VEL_MAX_DN = {float(pursuer.descent_m_s)!r}\n"
        )
    return (
        f"seed = {scenario.seed}\n"
        "[home]\n"
        f"lat_deg = {site.latitude_deg!r}\n"
        f"lon_deg = {site.longitude_deg!r}\n"
        f"alt_amsl_m = {site.altitude_amsl_m!r}\n"
        f"{_vehicle(PURSUER, pursuer.autopilot, PURSUER_ID, (home_y, home_x, 0.0))}{limits}"
        f"{_vehicle(EVADER, 'rover', EVADER_ID, (ey, ex, -evader.height_m))}"
    )


def _vehicle(name: str, flavour: str, system_id: int, start_ned_m: tuple[float, float, float]) -> str:
    start = ", ".join(repr(float(part)) for part in start_ned_m)
    return (
        "[[vehicle]]\n"
        f'name = "{name}"\n'
        f'flavour = "{flavour}"\n'
        f"system_id = {system_id}\n"
        f"start_ned_m = [{start}]\n"
        f"ready_after_s = {READY_AFTER_S!r}\n"
    )
