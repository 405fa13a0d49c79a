"""Steps of the velocity through the whole vehicle, bytes in and bytes out, against those measured on the real ones.

Measured on PX4 v1.17 (SIH) and ArduCopter 4.5.7: 8 s steps, 50 Hz setpoints, LOCAL_POSITION_NED; seconds to 10 and 63 %
of the command, and the mean of the last 2 s.
"""

from itertools import dropwhile

import pytest

pytestmark = pytest.mark.flight


STEPS = [
    # flavour, command (north, down), t10, t63, reached
    ("px4", (5.0, 0.0), 0.26, 1.00, 4.52),
    ("px4", (0.0, -5.0), 0.13, None, 2.98),
    ("px4", (0.0, 2.0), 0.12, 0.52, 1.51),
    ("arducopter", (5.0, 0.0), 0.57, 1.61, 5.04),
    ("arducopter", (0.0, -2.0), 0.40, 1.38, 1.95),
]


@pytest.mark.parametrize(("flavour", "command", "t10_s", "t63_s", "reached"), STEPS)
def test_a_step_rises_and_settles_as_measured(
    fly, ned_velocity, flavour, command, t10_s, t63_s, reached
):
    flight = fly.airborne(flavour, height=40.0)
    still = ned_velocity(0.0, 0.0, 0.0)
    flight.command(511, 32.0, 20_000.0)
    # PX4's estimate of its hover thrust is too high after a climb, which slows it.
    flight.offboard(still).run(30.0, still)
    start_s = flight.now_s
    flight.run(8.0, ned_velocity(command[0], 0.0, command[1]))
    size = command[0] or command[1]
    path = [
        (t - start_s, (m.vx if command[0] else m.vz) / size)
        for t, m in flight.all("LOCAL_POSITION_NED", start_s)
    ]

    def passes(share):
        return next(dropwhile(lambda sample: sample[1] < share, path))[0]

    assert passes(0.10) == pytest.approx(t10_s, abs=0.12)
    if t63_s is not None:
        assert passes(0.63) == pytest.approx(t63_s, abs=max(0.2, 0.2 * t63_s))
    settled = [share * abs(size) for t, share in path if t > 6.0]
    assert sum(settled) / len(settled) == pytest.approx(reached, abs=max(0.12, 0.04 * reached))


def test_feed_forward_of_acceleration_shortens_px4s_lag(fly):
    def stream(acceleration):
        return (
            "SET_POSITION_TARGET_LOCAL_NED",
            0,
            1,
            1,
            1,
            3079,
            0,
            0,
            0,
            3.0,
            0,
            0,
            acceleration,
            0,
            0,
            0,
            0,
        )

    reached = []
    for acceleration in (0.0, 2.0):
        flight = fly.airborne("px4", height=20.0).offboard(stream(0.0))
        flight.run(1.0, stream(acceleration))
        reached.append(flight.velocity[0])
    assert reached[1] > reached[0] + 0.3
