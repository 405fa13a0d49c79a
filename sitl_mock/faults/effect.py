"""Building blocks of faults: kinds with checked options, and their effects on frames, vehicles and transports."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from random import Random

    from sitl_mock.tables import Option
    from sitl_mock.vehicle.mock_vehicle import MockVehicle

Delayed = Sequence[tuple[float, bytes]]
"""Frames that replace one frame, each with its delay in seconds."""

Alter = Callable[[float, bytes], Delayed]


class Direction(StrEnum):
    """Direction of frames, seen from the vehicle."""

    OUT = "out"
    IN = "in"
    BOTH = "both"


class Group(StrEnum):
    """Group of faults in lists and documentation."""

    LINK = "link"
    FLIGHT = "flight"
    EVADER = "evader"


class EffectInputs(NamedTuple):
    """Inputs of the function that makes an effect.

    Attributes:
        vehicle: The affected vehicle.
        random: Source of randomness, seeded by script, vehicle and position.
        options: Checked values by name.
        messages: Names of the affected messages; empty for all.
    """

    vehicle: MockVehicle
    random: Random
    options: Mapping[str, Any]
    messages: tuple[str, ...] = ()


@dataclass(slots=True)
class Effect:
    """Callbacks of an active fault; each is given the time, none reads a clock.

    Attributes:
        prepare: Called once when the fault is added, before it begins.
        begin: Called when it begins.
        advance: Called at each step while it lasts; returns frames to add, each with the link that sends it.
        alter: Called for each affected frame.
        end: Called when it ends.
        transport: Disturbance of sockets or sessions (`router_restart`, `udp_port_change`).
    """

    prepare: Callable[[float], None] | None = None
    begin: Callable[[float], None] | None = None
    advance: Callable[[float], Iterable[tuple[str, bytes]]] | None = None
    alter: Alter | None = None
    end: Callable[[float], None] | None = None
    transport: str = ""


class Scope(NamedTuple):
    """Frames that a fault affects.

    Attributes:
        direction: Their direction.
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
        group: Its group.
        meaning: One line for `sitl-mock list faults`.
        make: Makes its effect on one vehicle.
        options: Its own keys.
        scope: The affected frames; None if it does not affect frames.
        for_s: Default duration; infinity: until the end, 0: instantaneous.
    """

    group: Group
    meaning: str
    make: Callable[[EffectInputs], Effect]
    options: Mapping[str, Option] = field(default_factory=dict)
    scope: Scope | None = None
    for_s: float = math.inf
