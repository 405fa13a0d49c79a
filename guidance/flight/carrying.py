"""What a cycle remembers of its own place, after the vehicle's position has jumped without the vehicle having moved."""

from guidance.cycle import CycleMemory
from guidance.frames import Vector


def carried(memory: CycleMemory, jump_ned_m: Vector) -> CycleMemory:
    """Move the place and the height that a hover holds, and the drift's position, along with the estimate.

    The vehicle is then held where it is, not sent to where it now believes that it was.

    Args:
        memory: Of the cycle before the jump.
        jump_ned_m: By how much the estimate jumped, metres.
    """
    north_m, east_m, down_m = jump_ned_m
    if not any(jump_ned_m):
        return memory
    drift, place, height = memory.follow.drift, memory.place, memory.height
    if drift.position_ned_m is not None:
        north, east, down = drift.position_ned_m
        drift = drift._replace(position_ned_m=(north + north_m, east + east_m, down + down_m))
    return memory._replace(
        follow=memory.follow._replace(drift=drift),
        place=None if place is None else (place[0] + north_m, place[1] + east_m),
        height=None if height is None else height._replace(down_m=height.down_m + down_m),
    )


def difference(one: Vector, other: Vector) -> Vector:
    """From the other to the one."""
    (north, east, down), (other_north, other_east, other_down) = one, other
    return (north - other_north, east - other_east, down - other_down)
