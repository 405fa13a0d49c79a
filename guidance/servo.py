"""Velocity servo: makes a real vehicle fly the velocity that the game asks for.

Autopilots answer a velocity setpoint late (0.5 to 1 s) and PX4 stays 8 to 19 % below it for many seconds. The servo
sends what closes the gap: the wanted velocity, plus what the vehicle is still missing of it (which makes the autopilot
accelerate as hard as the envelope lets it), plus a slow integral against the steady error.
"""

from dataclasses import dataclass

from guidance.telemetry import Vector


@dataclass(frozen=True, slots=True)
class ServoGains:
    """Gains of one vehicle profile.

    Attributes:
        lead: How much of the velocity still missing is added to the command (dimensionless).
        integral_per_s: Gain on the integral of the velocity error.
        integral_limit_m_s: Bound of the integral's share of the command.
        braking_m_s2: Deceleration the approach to the stand-off disc plans with.
        reaction_s: Time the vehicle flies on before it answers; the approach plans with it too.
    """

    lead: float = 0.6
    integral_per_s: float = 0.5
    integral_limit_m_s: float = 1.5
    braking_m_s2: float = 2.0
    reaction_s: float = 0.4


@dataclass(frozen=True, slots=True)
class ServoMemory:
    """The integral of the velocity error, in m/s of command, north-east-down."""

    integral_ned_m_s: Vector = (0.0, 0.0, 0.0)


def serve(
    wanted_ned_m_s: Vector, flown_ned_m_s: Vector, memory: ServoMemory, gains: ServoGains, *, dt_s: float
) -> tuple[Vector, ServoMemory]:
    """Turn the wanted velocity into the velocity to command.

    Args:
        wanted_ned_m_s: What the game asks for.
        flown_ned_m_s: What the vehicle flies, from its telemetry.
        memory: From the last call.
        gains: Of the vehicle's profile.
        dt_s: Seconds since the last call.

    Returns:
        The command before the limits, and the memory for the next call. The integral stands still on an axis whose
        error is larger than the integral could ever mend, so that it does not wind up while the vehicle accelerates.
    """
    command: list[float] = []
    integral: list[float] = []
    for wanted, flown, summed in zip(wanted_ned_m_s, flown_ned_m_s, memory.integral_ned_m_s, strict=True):
        error = wanted - flown
        if abs(error) <= gains.integral_limit_m_s:
            summed = _clip(summed + gains.integral_per_s * error * dt_s, gains.integral_limit_m_s)  # noqa: PLW2901
        command.append(wanted + gains.lead * error + summed)
        integral.append(summed)
    return (command[0], command[1], command[2]), ServoMemory((integral[0], integral[1], integral[2]))


def _clip(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
