"""RC_CHANNELS_OVERRIDE on ArduPilot: every channel expires by itself, RC_OVERRIDE_TIME seconds after it was set."""

import pytest

GROUND = (255, 190)
UNCHANGED = 65535
FORWARD = 1300
CENTRE = 1500


def override(*pulses):
    """RC_CHANNELS_OVERRIDE with the first channels as given, the others unchanged."""
    return ("RC_CHANNELS_OVERRIDE", 1, 1, *pulses, *[UNCHANGED] * (8 - len(pulses)), *[0] * 10)


@pytest.fixture
def loitering(fly):
    """A copter in LOITER at 30 m under a client that pushes it forward; parameters by keyword."""

    def made(**parameters):
        flight = fly.airborne("arducopter", source=GROUND, height=30.0).change(**parameters)
        flight.command(176, 1, 5)
        return flight.run(2.0, override(CENTRE, FORWARD, CENTRE, CENTRE), 0.1)

    return made


def sticks(flight):
    return flight.vehicle.autopilot.commander.sticks


def test_65535_does_not_keep_a_channel_alive(loitering):
    flight = loitering()
    assert flight.velocity[0] > 2.0
    flight.run(2.5, override(), 0.1)
    assert sticks(flight).pitch == pytest.approx(0.4)
    flight.run(1.0, override(), 0.1)
    assert sticks(flight).pitch == 0.0
    assert sticks(flight).throttle == -1.0, "the simulator's radio rests with the throttle down"


def test_a_channel_expires_while_another_one_is_kept(loitering):
    flight = loitering()
    flight.run(3.5, override(UNCHANGED, UNCHANGED, CENTRE), 0.1)
    assert sticks(flight).pitch == 0.0
    assert sticks(flight).throttle == 0.0
    assert flight.velocity[2] == pytest.approx(0.0, abs=0.2)


@pytest.mark.parametrize(("time_s", "held_s"), [(1.0, 0.9), (6.0, 5.8), (-1.0, 30.0)])
def test_rc_override_time_is_obeyed(loitering, time_s, held_s):
    flight = loitering(RC_OVERRIDE_TIME=time_s)
    flight.run(held_s)
    assert sticks(flight).pitch == pytest.approx(0.4)
    flight.run(0.3)
    assert (sticks(flight).pitch == 0.0) is (time_s > 0.0)


def test_rc_override_time_0_turns_overrides_off(fly):
    flight = fly("arducopter", source=GROUND, parameters={"RC_OVERRIDE_TIME": 0.0}).run(1.0)
    flight.send(*override(CENTRE, FORWARD, CENTRE, CENTRE))
    assert sticks(flight).pitch == 0.0


def test_0_releases_a_channel_at_once(loitering):
    flight = loitering()
    flight.send(*override(UNCHANGED, 0))
    assert sticks(flight).pitch == 0.0
    assert sticks(flight).throttle == 0.0


def test_manual_control_expires_like_an_override(loitering):
    flight = loitering(RC_OVERRIDE_TIME=1.0)
    flight.send("MANUAL_CONTROL", 1, 1000, 0, 500, 0, *[0] * 11)
    assert sticks(flight).pitch == 1.0
    flight.run(1.1)
    assert sticks(flight).pitch == 0.0


def test_a_switch_above_channel_8_changes_the_mode(fly):
    flight = fly.airborne("arducopter", source=GROUND, height=30.0)
    flight.change(FLTMODE_CH=9, FLTMODE1=9)
    flight.send("RC_CHANNELS_OVERRIDE", 1, 1, *[UNCHANGED] * 8, 1000, *[0] * 9)
    flight.run(0.3)
    assert flight.mode == "LAND"


def test_a_rover_that_loses_its_client_stands_still(fly):
    flight = fly("rover", source=GROUND, parameters={"RC_OVERRIDE_TIME": 1.0}).run(2.0)
    assert flight.command(400, 1.0) == [0]
    flight.run(3.0, override(CENTRE, UNCHANGED, 1800, CENTRE), 0.1)
    assert flight.velocity[0] > 0.5
    flight.run(6.0)
    assert flight.velocity[0] == pytest.approx(0.0, abs=0.05)
