"""ArduCopter's parameters behind another one are listed once that one is not 0 (read from 4.5.7)."""

import pytest

SWITCHES = {
    "INS_HNTCH_ENABLE": 8,
    "GRIP_ENABLE": 7,
    "SPRAY_ENABLE": 4,
    "CHUTE_ENABLED": 7,
    "LGR_ENABLE": 8,
    "CAM1_TYPE": 12,
    "MNT1_TYPE": 19,
    "RNGFND1_TYPE": 15,
    "BATT2_MONITOR": 13,
}


def listed(flight):
    """Names of PARAM_REQUEST_LIST in the order of their indices, and the count that each answer tells."""
    since_s = flight.now_s + 0.005
    flight.send("PARAM_REQUEST_LIST", 1, 1)
    flight.run(4.0)
    values = [m for _, m in flight.all("PARAM_VALUE", since_s)]
    assert [m.param_index for m in values] == list(range(len(values)))
    assert {m.param_count for m in values} == {len(values)}
    return [m.param_id for m in values]


def put(flight, name, value):
    """Set a parameter; return the answer's value."""
    flight.send("PARAM_SET", 1, 1, name, value, 9)
    answer = flight.last("PARAM_VALUE")
    assert answer.param_id == name
    return answer.param_value


@pytest.fixture(scope="module")
def recorded(fly):
    return listed(fly("arducopter").run(0.5))


def test_without_a_switch_the_recorded_list_is_listed(recorded):
    assert len(recorded) == 1390


@pytest.mark.parametrize(("switch", "count"), SWITCHES.items())
def test_a_switch_shows_the_parameters_behind_it(fly, recorded, switch, count):
    flight = fly("arducopter").run(0.5)
    assert put(flight, switch, 1.0) == 1.0
    names = listed(flight)
    assert len(names) == len(recorded) + count
    place = names.index(switch)
    assert set(names[place + 1 : place + 1 + count]).isdisjoint(recorded)
    put(flight, switch, 0.0)
    assert listed(flight) == recorded


def test_a_hidden_parameter_is_read_and_set_by_name(fly):
    flight = fly("arducopter").run(0.5)
    assert put(flight, "INS_HNTCH_FREQ", 70.0) == 70.0
    flight.send("PARAM_REQUEST_READ", 1, 1, "INS_HNTCH_FREQ", -1)
    assert flight.last("PARAM_VALUE").param_value == 70.0
    assert "INS_HNTCH_FREQ" not in flight.vehicle.autopilot.parameters.names


def test_a_later_version_hides_them_too(fly):
    flight = fly("arducopter", spec="arducopter@4.7").run(0.5)
    assert "SPRAY_SPEED_MIN" not in listed(flight)
    put(flight, "SPRAY_ENABLE", 1.0)
    assert "SPRAY_SPEED_MIN" in listed(flight)
