"""A multicopter: one control law on one airframe, stepped as a pure function."""

import math
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

from sitl_mock.dynamics.airframe import Airframe, body_at, step_body
from sitl_mock.dynamics.shaping import Reference
from sitl_mock.dynamics.values import CALM, Body, Demand, Estimate, Kind, Motion, Ned, Setpoint, Surroundings

MemoryT = TypeVar("MemoryT")


class Control(Protocol[MemoryT]):
    """A control law: from what the autopilot believes and is asked, to lean, thrust and yaw rate."""

    def fresh(self, estimate: Estimate, *, flying: bool) -> MemoryT:
        """Memory of a vehicle just placed."""
        ...

    def step(
        self, memory: MemoryT, body: Body, estimate: Estimate, setpoint: Setpoint, dt_s: float
    ) -> tuple[MemoryT, Demand]:
        """One step of the law."""
        ...


class Pending(NamedTuple):
    """Setpoints between the radio and the control law: what is obeyed now, and what will be and when."""

    clock_s: float
    obeyed: Setpoint
    waiting: tuple[tuple[float, Setpoint], ...] = ()


def take(pending: Pending, setpoint: Setpoint, delay_s: float, dt_s: float) -> Pending:
    """The setpoints one step on: a streamed one waits for `delay_s`, any other order is obeyed at once."""
    clock_s, obeyed, waiting = pending
    if setpoint.kind is not Kind.STREAM and setpoint.kind is not Kind.DIRECT:
        return Pending(clock_s + dt_s, setpoint)
    if setpoint is not (waiting[-1][1] if waiting else obeyed):
        waiting = (*waiting, (clock_s + delay_s, setpoint))
    now_s = clock_s + 0.5 * dt_s
    while waiting and waiting[0][0] <= now_s:
        obeyed, waiting = waiting[0][1], waiting[1:]
    return Pending(clock_s + dt_s, obeyed, waiting)


@dataclass(frozen=True)
class Multicopter(Generic[MemoryT]):
    """A multicopter of one flavour.

    Attributes:
        control: The flavour's control law.
        memory_type: The type of the law's memory; any other memory starts afresh.
        airframe: The body.
        velocity_scale_ned: What the estimator makes of a true velocity, per axis (1 is perfect).
        setpoint_delay_s: Dead time from a streamed setpoint's arrival until the control law has it.
        step_max_s: Longer steps are divided.
    """

    control: Control[MemoryT]
    memory_type: type[MemoryT]
    airframe: Airframe
    velocity_scale_ned: Ned = (1.0, 1.0, 1.0)
    setpoint_delay_s: float = 0.0
    step_max_s: float = 0.02

    def initial(self, position_ned_m: Ned, yaw_rad: float, *, flying: bool = False) -> Motion:
        """A vehicle at rest: motors stopped on the ground, or (`flying`) hovering in trim."""
        body = body_at(position_ned_m, yaw_rad, on_ground=not flying)
        return Motion(body, self._fresh(body, self.estimate(body, CALM)))

    def _fresh(self, body: Body, estimate: Estimate) -> tuple[Pending, MemoryT]:
        flying = not body.on_ground
        order = Setpoint(Kind.BRAKE if flying else Kind.STOPPED)
        return Pending(0.0, order), self.control.fresh(estimate, flying=flying)

    def estimate(self, body: Body, around: Surroundings) -> Estimate:
        """What the autopilot believes: truth, the estimator's scale and the errors of the surroundings."""
        (p_n, p_e, p_d), (v_n, v_e, v_d) = body.position_ned_m, body.velocity_ned_m_s
        (q_n, q_e, q_d), (w_n, w_e, w_d) = around.position_error_ned_m, around.velocity_error_ned_m_s
        s_n, s_e, s_d = self.velocity_scale_ned
        return Estimate((p_n + q_n, p_e + q_e, p_d + q_d), (v_n * s_n + w_n, v_e * s_e + w_e, v_d * s_d + w_d))

    def step(self, motion: Motion, setpoint: Setpoint, around: Surroundings, dt_s: float) -> Motion:
        """The vehicle `dt_s` later under one setpoint, in equal steps of at most `step_max_s`."""
        body = motion.body
        estimate = self.estimate(body, around)
        pending, memory = self._memory(motion, estimate)
        count = max(1, math.ceil(dt_s / self.step_max_s - 1e-9))
        inner_s = dt_s / count
        for left in range(count, 0, -1):
            pending = take(pending, setpoint, self.setpoint_delay_s, inner_s)
            memory, demand = self.control.step(memory, body, estimate, pending.obeyed, inner_s)
            body = step_body(self.airframe, body, demand, around, inner_s)
            if left > 1:
                estimate = self.estimate(body, around)
        return Motion(body, (pending, memory))

    def reference(self, motion: Motion) -> Reference | None:
        """The motion that the control follows."""
        carried = motion.memory
        known = isinstance(carried, tuple) and isinstance(carried[1], self.memory_type)
        return getattr(carried[1], "reference", None) if known and isinstance(carried, tuple) else None

    def _memory(self, motion: Motion, estimate: Estimate) -> tuple[Pending, MemoryT]:
        """The memory handed back, or a fresh one where it is another flavour's."""
        carried = motion.memory
        if isinstance(carried, tuple) and isinstance(carried[1], self.memory_type):
            return carried[0], carried[1]
        return self._fresh(motion.body, estimate)
