"""A package from outside: an evader source, a link, an autopilot, a speed set, an output with a section, and a law."""

import math
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from guidance.links import MemoryWire
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.plugins import (
    PX4,
    Ball,
    EvaderKind,
    EvaderReport,
    LinkError,
    LinkKind,
    Ned,
    Section,
    Sink,
)
from sitl_mock import Home, MockVehicle


class BuoyKeys(Section):
    """Keys of `[evader]` with kind = "buoy"."""

    callsign: str = Field(min_length=1, max_length=8, description="of the only buoy that is heard")
    north_m: float = Field(30.0, ge=0.0, le=100.0, description="from its anchor")


class Buoy:
    """Reports its place ten times a second."""

    def __init__(self, order):
        if not order.url.startswith("buoy://"):
            raise LinkError(
                f"evader.url = {order.url!r}: must be buoy://latitude,longitude,altitude"
            )
        self.clock = order.clock
        self.callsign = order.section.callsign
        latitude_deg, longitude_deg, altitude_m = map(float, order.url[7:].split(","))
        self.place = (latitude_deg + order.section.north_m / 111_195.0, longitude_deg, altitude_m)
        self.counts = Counter(reports=0)
        self.next_s = -math.inf

    def receive(self):
        now_s = self.clock()
        if now_s < self.next_s:
            return []
        self.next_s = now_s + 0.1
        self.counts["reports"] += 1
        still = Ned((0.0, 0.0, 0.0))
        return [EvaderReport(now_s, math.nan, self.callsign, *self.place, still)]

    def counters(self):
        return dict(self.counts)

    def close(self):
        """Nothing is open."""


BUOY = EvaderKind(
    name="buoy",
    message="a buoy that does not move",
    transport="other",
    needs={"url": "needs the address of the buoy"},
    section=BuoyKeys,
    open=Buoy,
)


class SimulatorKeys(Section):
    """Keys of `[vehicle]` with link = "simulator"."""

    url: str = Field(pattern="^simulator://", description="simulator://latitude,longitude,altitude")
    fence_m: float = Field(120.0, gt=0.0, description="the simulated autopilot's own fence")


class Simulator:
    """A vehicle in this process; nobody else sees its bytes."""

    def __init__(self, order):
        place = map(float, order.section.url.removeprefix("simulator://").split(","))
        own_fence = {"GF_MAX_HOR_DIST": order.section.fence_m, "GF_MAX_VER_DIST": 70.0}
        self.clock = order.clock
        self.vehicle = MockVehicle(
            "px4", home=Home(*place), noise=False, parameters=own_fence, ready_after_s=0.5
        )
        ours, self.end = MemoryWire.pair(order.clock)
        self.link = PymavlinkLink(ours, order.clock, system_id=1)
        self.send_setpoint = self.link.send_setpoint
        self.request = self.link.request
        self.send_heartbeat = self.link.send_heartbeat
        self.counters = self.link.counters
        self.close = self.link.close

    def receive(self):
        sent = [frame for _, frame in self.end.receive()]
        for frame in self.vehicle.step(self.clock(), sent):
            self.end.send(frame)
        return self.link.receive()


SIMULATOR = LinkKind(
    name="simulator",
    first="nothing",
    by_mavlink=False,
    section=SimulatorKeys,
    open=Simulator,
)

TOY = replace(PX4, name="toy")


@dataclass(frozen=True, slots=True, eq=False)
class Halved(Ball):
    """A ball of half the speed that files give."""

    name = "halved"

    @classmethod
    def of(cls, horizontal_m_s, climb_m_s, descent_m_s):
        return cls(0.5 * horizontal_m_s)


class TallyKeys(Section):
    """[tally]"""

    every_s: float = Field(gt=0.0, description="between two counts")


class Tally(Sink):
    """Counts cycles."""

    def __init__(self, every_s):
        self.every_s = every_s
        self.cycles = 0

    def cycle(self, entry):
        self.cycles += 1


def open_tally(order):
    section = None if order.config is None else order.config.section(TallyKeys)
    return None if section is None else Tally(section.every_s)


def chase(observations, lead_s=0.0):
    """Fly straight at the place of the disc some seconds from now."""
    way = observations[:, :3].copy()
    way[:, :2] += lead_s * observations[:, 3:5]
    return way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1.0)
