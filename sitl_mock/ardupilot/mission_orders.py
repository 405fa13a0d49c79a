"""Items of a mission without a position, executed in AUTO: turn the nose, switch the fence, move home."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from sitl_mock.missions.flight import CONDITION_YAW, NAV_DELAY
from sitl_mock.protocols import Command
from sitl_mock.vehicle.state import Severity

if TYPE_CHECKING:
    from sitl_mock.ardupilot.commander import ArduPilot

DO_SET_HOME: Final = 179
DO_FENCE_ENABLE: Final = 207
_AS_COMMANDS: Final = frozenset({CONDITION_YAW, DO_SET_HOME, DO_FENCE_ENABLE})
_TURNED_RAD: Final = math.radians(2.0)
"""CONDITION_YAW is met this close to its heading."""
_AUTOPILOT: Final = 1


def obey_orders(commander: ArduPilot) -> None:
    """Execute the items that the mission leaves to the commander; a turn ends with the item that it began in."""
    flight = commander.flight
    mission = commander.mission
    if flight.turn is not None and flight.turn_item != mission.current:
        flight.turn = None
    for item in mission.orders:
        if item.command in _AS_COMMANDS:
            fields = (item.param1, item.param2, item.param3, item.param4)
            position = (item.latitude_deg, item.longitude_deg, item.z)
            source = (commander.state.system_id, _AUTOPILOT)
            commander.execute(
                commander.state.now_s,
                Command(item.command, (*fields, *position), item.frame, True, source, 0),
            )
        if item.command == CONDITION_YAW:
            flight.turn_item = mission.current
        if item.command == DO_FENCE_ENABLE:
            word = "Enabled" if item.param1 else "Disabled"
            commander.state.say(Severity.INFO, f"Fence {word}")
    mission.orders.clear()
    # The mission turns until the nose is at the heading of the last CONDITION_YAW.
    mission.turning = False
    turn = flight.turn
    if turn is not None:
        off_rad = math.remainder(turn.heading_rad - commander.state.yaw_rad, math.tau)
        mission.turning = turn.left_rad != 0.0 or abs(off_rad) > _TURNED_RAD


def tell_delay(commander: ArduPilot, seq: int) -> None:
    """Say how long a NAV_DELAY waits when it becomes the present item in place of item `seq`."""
    mission = commander.mission
    items = mission.plans.mission.items
    if mission.current == seq or mission.current >= len(items):
        return
    item = items[mission.current]
    if item.command == NAV_DELAY:
        seconds = int(max(item.param1, 0.0)) if math.isfinite(item.param1) else 0
        commander.state.say(Severity.INFO, f"Delaying {seconds} sec")
