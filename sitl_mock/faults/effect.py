"""What a fault is made of: options with their checks, and what it does to frames, to a vehicle or to a transport."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from random import Random

    from sitl_mock.tables import Option
    from sitl_mock.vehicle import MockVehicle

Passed = Sequence[tuple[float, bytes]]
"""What becomes of one frame: any number of frames, each with the seconds by which it is late."""

Alter = Callable[[float, bytes], Passed]


class Direction(StrEnum):
    """Which way frames go: out of the vehicle, in to it, or both."""

    OUT = "out"
    IN = "in"
    BOTH = "both"


class Group(StrEnum):
    """What a fault strikes."""

    LINK = "link"
    FLIGHT = "flight"
    EVADER = "evader"


class Making(NamedTuple):
    """What an effect is made from.

    Attributes:
        vehicle: The one it strikes.
        random: Its own source of randomness, seeded by script, vehicle and position.
        options: Checked values by name.
        messages: Names of the messages struck; empty for all.
    """

    vehicle: MockVehicle
    random: Random
    options: Mapping[str, Any]
    messages: tuple[str, ...] = ()


@dataclass(slots=True)
class Effect:
    """What a fault does while it lasts. Every call is given the time; none reads a clock.

    Attributes:
        prepare: Called once when the fault is put in place, before it begins.
        begin: Called when it begins.
        advance: Called at each step while it lasts; returns frames to add, each with the link that sends it.
        alter: Called for each frame that it strikes.
        end: Called when it ends.
        transport: What happens to the sockets or sessions (`router_restart`, `udp_port_change`).
    """

    prepare: Callable[[float], None] | None = None
    begin: Callable[[float], None] | None = None
    advance: Callable[[float], Iterable[tuple[str, bytes]]] | None = None
    alter: Alter | None = None
    end: Callable[[float], None] | None = None
    transport: str = ""


class Scope(NamedTuple):
    """Which frames a fault strikes.

    Attributes:
        direction: Which way they go.
        messages: Names of messages; empty for every frame.
        open: Whether a script may choose others.
    """

    direction: Direction = Direction.OUT
    messages: tuple[str, ...] = ()
    open: bool = False


@dataclass(frozen=True)
class FaultKind:
    """One kind of fault.

    Attributes:
        group: What it strikes.
        meaning: One line for `sitl-mock list faults`.
        make: Makes its effect on one vehicle.
        options: Its own keys.
        scope: Which frames; None if it does not strike frames.
        for_s: How long it lasts if the script does not say; infinity for until the end, 0 for at once.
    """

    group: Group
    meaning: str
    make: Callable[[Making], Effect]
    options: Mapping[str, Option] = field(default_factory=dict)
    scope: Scope | None = None
    for_s: float = math.inf
