"""Autopilots of other versions: a relay renames and rescales the mock's parameters, and preflight judges the same."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.flight import State
from tests.harness.vehicle import FENCED
from tests.session.test_uploaded_fence import FENCED_ARDUCOPTER

ARDUCOPTER = {"vehicle": {"autopilot": "arducopter"}}
RENAMED_4_7 = {
    "RTL_ALT": ("RTL_ALT_M", 0.01),
    "WPNAV_SPEED": ("WP_SPD", 0.01),
    "WPNAV_SPEED_UP": ("WP_SPD_UP", 0.01),
    "WPNAV_SPEED_DN": ("WP_SPD_DN", 0.01),
    "ANGLE_MAX": ("ATC_ANGLE_MAX", 0.01),
}
"""The name of 4.5, and for 4.7 the name and the factor of the unit."""


class Relay:
    """Between service and vehicle: another version, and parameters with other names and units."""

    def __init__(self, number, renamed):
        major, minor, patch = number
        self._version = major << 24 | minor << 16 | patch << 8 | 255
        self._renamed = renamed
        self._old = {new: (old, factor) for old, (new, factor) in renamed.items()}

    def to_vehicle(self, frame):
        """Return what the vehicle hears; None for a parameter that it no longer has."""
        message = mavlink.MAVLink(None).decode(bytearray(frame))
        name = getattr(message, "param_id", "")
        if name in self._renamed:
            return None
        if name not in self._old:
            return frame
        old_name, factor = self._old[name]
        changed = mavlink.MAVLink_param_request_read_message(1, 1, old_name.encode(), -1)
        if message.get_type() == "PARAM_SET":
            value = message.param_value / factor
            changed = mavlink.MAVLink_param_set_message(1, 1, old_name.encode(), value, 9)
        return bytes(changed.pack(mavlink.MAVLink(None, 1, 195)))

    def from_vehicle(self, frame):
        """Return what the service hears."""
        message = mavlink.MAVLink(None).decode(bytearray(frame))
        if message.get_type() == "AUTOPILOT_VERSION":
            message.flight_sw_version = self._version
        elif message.get_type() == "PARAM_VALUE" and message.param_id in self._renamed:
            name, factor = self._renamed[message.param_id]
            value = message.param_value * factor
            message = mavlink.MAVLink_param_value_message(name.encode(), value, 9, 1, 0)
        else:
            return frame
        return bytes(message.pack(mavlink.MAVLink(None, 1, 1)))


def relay(service, number, renamed):
    """Put a relay between service and vehicle."""
    step = service.vehicle.step
    between = Relay(number, renamed)

    def relayed(now_s, frames=()):
        passed = [between.to_vehicle(frame) for frame in frames]
        sent = step(now_s, [frame for frame in passed if frame is not None])
        return [between.from_vehicle(frame) for frame in sent]

    service.vehicle.step = relayed
    return service


def rows_of(service):
    service.run(11.0)
    return {row.name: row for row in service.daemon.survey.rows}


def test_arducopter_4_7_is_judged_by_its_own_names_and_units(base):
    """Catches centimetres that are judged as metres."""
    low = {**FENCED_ARDUCOPTER, "RTL_ALT": 12_000, "ANGLE_MAX": 1000}
    rows = rows_of(relay(base(parameters=low, **ARDUCOPTER), (4, 7, 0), RENAMED_4_7))
    assert (rows["autopilot version"].value, rows["autopilot version"].verdict) == ("4.7.0", "pass")
    assert (rows["RTL_ALT_M"].value, rows["RTL_ALT_M"].verdict) == ("120 m", "refuse")
    assert rows["RTL_ALT_M"].advice.startswith("param set RTL_ALT_M 60")
    assert (rows["ATC_ANGLE_MAX"].value, rows["ATC_ANGLE_MAX"].verdict) == ("10°", "warn")
    assert rows["ATC_ANGLE_MAX"].advice.startswith("param set ATC_ANGLE_MAX 30")
    assert rows["WP_SPD"].verdict == "pass"
    assert not set(RENAMED_4_7) & set(rows)


@pytest.mark.flight
def test_arducopter_4_7_flies(base):
    service = relay(base(parameters=FENCED_ARDUCOPTER, **ARDUCOPTER), (4, 7, 0), RENAMED_4_7)
    service.until(State.READY)
    assert service.order("start")["accepted"]
    service.until(State.STANDING_BY)
    assert service.order("engage")["accepted"]
    service.until(State.ENGAGED)


@pytest.mark.parametrize(("speed", "verdict"), [(1.0, "pass"), (-1.0, "warn")])
def test_px4_1_18_says_whether_the_sticks_take_over(base, speed, verdict):
    """Catches a rule of 1.17 that judges 1.18."""
    service = base(parameters=FENCED)
    step = service.vehicle.step
    vehicle = mavlink.MAVLink(None, 1, 1)
    values = {"MAN_OVERRIDE_SPD": speed, "NAV_RCL_ACT": 7.0}

    def answers(now_s, frames=()):
        passed = []
        answered = []
        for frame in frames:
            message = mavlink.MAVLink(None).decode(bytearray(frame))
            name = getattr(message, "param_id", "")
            if name in values:
                answer = mavlink.MAVLink_param_value_message(name.encode(), values[name], 9, 1, 0)
                answered.append(bytes(answer.pack(vehicle)))
            else:
                passed.append(frame)
        return [*step(now_s, passed), *answered]

    service.vehicle.step = answers
    rows = rows_of(relay(service, (1, 18, 0), {}))
    assert (rows["MAN_OVERRIDE_SPD"].verdict) == verdict
    assert "COM_RC_OVERRIDE" not in rows
    if verdict == "warn":
        assert "the sticks do not end OFFBOARD" in rows["MAN_OVERRIDE_SPD"].advice
    radio_loss = rows["NAV_RCL_ACT"]
    assert (radio_loss.value, radio_loss.verdict) == ("7 (Hold without failsafe)", "warn")
    assert "radio loss is ignored in OFFBOARD" in radio_loss.advice


def test_a_quantity_that_the_version_should_have_and_has_not_is_refused_with_the_reason(base):
    """Catches a quantity that nobody answers and that counts as safe."""
    rows = rows_of(relay(base(parameters=FENCED), (1, 18, 0), {}))
    row = rows["MAN_OVERRIDE_SPD"]
    assert (row.value, row.verdict) == ("not read", "refuse")
    assert "the pilot's sticks take over is unknown" in row.advice
