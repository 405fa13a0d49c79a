"""A multicopter: one control law on one airframe, stepped as a pure function."""

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from sitl_mock.dynamics.airframe import Airframe, body_at, step_body
from sitl_mock.dynamics.values import Body, Demand, Estimate, Motion, Ned, Setpoint, Surroundings

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


@dataclass(frozen=True)
class Multicopter(Generic[MemoryT]):
    """A multicopter of one flavour.

    Attributes:
        control: The flavour's control law.
        memory_type: The type of the law's memory; any other memory starts afresh.
        airframe: The body.
        velocity_scale_ned: What the estimator makes of a true velocity, per axis (1 is perfect).
        step_max_s: Longer steps are divided.
    """

    control: Control[MemoryT]
    memory_type: type[MemoryT]
    airframe: Airframe
    velocity_scale_ned: Ned = (1.0, 1.0, 1.0)
    step_max_s: float = 0.02

    def initial(self, position_ned_m: Ned, yaw_rad: float, *, flying: bool = False) -> Motion:
        """A vehicle at rest: motors stopped on the ground, or (`flying`) hovering in trim."""
        body = body_at(position_ned_m, yaw_rad, on_ground=not flying)
        estimate = self.estimate(body, Surroundings())
        return Motion(body, self.control.fresh(estimate, flying=flying))

    def estimate(self, body: Body, around: Surroundings) -> Estimate:
        """What the autopilot believes: truth, the estimator's scale and the errors of the surroundings."""
        (p_n, p_e, p_d), (v_n, v_e, v_d) = body.position_ned_m, body.velocity_ned_m_s
        (q_n, q_e, q_d), (w_n, w_e, w_d) = around.position_error_ned_m, around.velocity_error_ned_m_s
        s_n, s_e, s_d = self.velocity_scale_ned
        return Estimate((p_n + q_n, p_e + q_e, p_d + q_d), (v_n * s_n + w_n, v_e * s_e + w_e, v_d * s_d + w_d))

    def step(self, motion: Motion, setpoint: Setpoint, around: Surroundings, dt_s: float) -> Motion:
        """The vehicle `dt_s` later under one setpoint, in equal steps of at most `step_max_s`."""
        body, memory = motion
        estimate = self.estimate(body, around)
        if not isinstance(memory, self.memory_type):
            memory = self.control.fresh(estimate, flying=not body.on_ground)
        count = max(1, -int(-dt_s // self.step_max_s + 1e-9))
        inner_s = dt_s / count
        for left in range(count, 0, -1):
            memory, demand = self.control.step(memory, body, estimate, setpoint, inner_s)
            body = step_body(self.airframe, body, demand, around, inner_s)
            if left > 1:
                estimate = self.estimate(body, around)
        return Motion(body, memory)
