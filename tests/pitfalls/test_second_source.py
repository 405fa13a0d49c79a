"""A second source of setpoints between our own: noticed within two seconds, however seldom it speaks."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.flight import Event, State

pytestmark = pytest.mark.flight


CYCLE_S = 0.02


def joined_by(flight, rate_hz, phase_s, velocity=(-3.0, -3.0, 0.0)):
    """Let another program send a velocity at its own rate, so long after one of ours."""
    stranger = mavlink.MAVLink(None, 255, 190)
    vehicle = flight.world.faulted["pursuer"]
    real_step = vehicle.step
    begun_s = flight.now_s + CYCLE_S
    sent = 0

    def step(now_s, frames=(), link=None):
        nonlocal sent
        # Ours arrive at the begin of a cycle
        told = list(real_step(now_s - CYCLE_S + 0.002, frames, link))
        at_s = begun_s + sent / rate_hz + phase_s
        if at_s <= now_s + 1e-9:
            sent += 1
            message = mavlink.MAVLink_set_position_target_local_ned_message(
                int(now_s * 1000), 1, 1, 1, 3527, 0, 0, 0, *velocity, 0, 0, 0, 0, 0
            )
            told += real_step(max(at_s, now_s - CYCLE_S + 0.002), [message.pack(stranger)], link)
        return [*told, *real_step(now_s, [], link)]

    vehicle.step = step
    return begun_s


@pytest.mark.parametrize("rate_hz", [2.0, 5.0, 20.0])
@pytest.mark.parametrize("phase_s", [0.003, 0.015])
def test_a_second_source_is_noticed_within_two_seconds(sortie, autopilot, rate_hz, phase_s):
    flight = sortie.engaged(autopilot).run(2.5)
    begun_s = joined_by(flight, rate_hz, phase_s)
    flight.until(State.HOLDING, limit_s=2.0)
    assert flight.events[-1] is Event.FOREIGN
    assert flight.now_s - begun_s < 2.0
    flight.until_mock({"px4": "HOLD", "arducopter": "BRAKE"}[autopilot], 2.0)


def test_a_second_source_that_sends_what_we_send_is_none(sortie, autopilot):
    flight = sortie.engaged(autopilot).run(2.5)
    joined_by(flight, 10.0, 0.01, velocity=flight.setpoints[-1].velocity)
    flight.run(2.0)
    assert Event.FOREIGN not in flight.events
