"""Row 14: PREFLIGHT_CALIBRATION on PX4 v1.17 (SIH), asked kind by kind; times in seconds after the request.

Texts and COMMAND_ACKs of the real one: 0 accepted, 1 temporarily rejected, 2 denied, 3 unsupported.
"""

import math

import pytest

CALIBRATE = 241
ARM = 400
GYRO = (1,)
MAG = (0, 1)
BARO = (0, 0, 1)
RADIO = (0, 0, 0, 1)
ACCEL = (0, 0, 0, 0, 1)
LEVEL = (0, 0, 0, 0, 2)
AIRSPEED = (0, 0, 0, 0, 0, 1)
ESC = (0, 0, 0, 0, 0, 0, 1)
HEARTBEAT = ("HEARTBEAT", 6, 8, 0, 0, 4, 3)

SAID = {
    GYRO: [
        "calibration started: 2 gyro",
        *(f"progress <{n}>" for n in range(0, 101, 10)),
        "calibration done: gyro",
    ],
    LEVEL: [
        "calibration started: 2 level",
        *(f"progress <{n}>" for n in (0, 20, 40, 60, 80, 100, 100)),
        "calibration done: level",
    ],
    BARO: ["calibration started: 2 baro"],
    AIRSPEED: ["calibration started: 2 airspeed", "Ensure sensor is not measuring wind"],
    MAG: [
        "calibration started: 2 mag",
        "pending: back front left right up down",
        "hold vehicle still on a pending side",
        "detected rest position, hold still...",
        "down orientation detected",
        "down orientation detected",
        "Rotate vehicle",
    ],
}
DONE_S = {GYRO: 1.09, LEVEL: 0.64}


@pytest.fixture
def standing(fly):
    """A PX4 that a ground station hears."""
    flight = fly("px4")
    flight.send(*HEARTBEAT)
    return flight.run(1.0, HEARTBEAT, every_s=0.5)


def ask(flight, params, wait_s=0.06):
    return flight.command(CALIBRATE, *params, *[0.0] * (7 - len(params)), wait_s=wait_s)


@pytest.mark.parametrize("kind", SAID)
def test_the_texts_are_the_real_ones(standing, kind):
    assert ask(standing, kind) == [0]
    standing.run(11.0, HEARTBEAT, every_s=0.5)
    assert standing.texts() == [f"[cal] {text}" for text in SAID[kind]]


@pytest.mark.parametrize(
    ("name", "bit", "title"),
    [("CAL_GYRO0_ID", 1, "Gyro"), ("CAL_ACC0_ID", 2, "Accel"), ("CAL_MAG0_ID", 4, "Compass")],
)
def test_a_sensor_without_its_calibration_is_unhealthy_and_bars_arming(standing, name, bit, title):
    calibrated = standing.vehicle.autopilot.state.parameters[name]
    health = standing.last("SYS_STATUS").onboard_control_sensors_health
    standing.send("PARAM_SET", 1, 1, name.encode(), 0.0, 6)
    standing.run(1.5, HEARTBEAT, every_s=0.5)
    prearm = 1 << 28
    assert standing.last("SYS_STATUS").onboard_control_sensors_health == health - bit - prearm
    assert standing.command(ARM, 1.0) == [1]
    assert standing.texts()[-1] == f"Preflight Fail: {title} 0 uncalibrated"
    if title == "Gyro":
        ask(standing, GYRO)
        standing.run(2.0, HEARTBEAT, every_s=0.5)
        assert standing.vehicle.autopilot.state.parameters[name] == calibrated
        assert standing.last("SYS_STATUS").onboard_control_sensors_health == health


@pytest.mark.parametrize("kind", DONE_S)
def test_it_is_done_when_the_real_one_is(standing, kind):
    asked_s = standing.now_s
    ask(standing, kind)
    took_s = standing.until(
        lambda: any("calibration done" in text for text in standing.texts()), 3.0, HEARTBEAT
    )
    assert standing.now_s - asked_s == pytest.approx(DONE_S[kind], abs=0.1), took_s
    assert ask(standing, GYRO) == [0], "and another one may follow"


def test_the_accelerometer_wants_every_side_and_a_vehicle_that_stands_has_one(standing):
    assert ask(standing, ACCEL) == [0]
    standing.run(16.0, HEARTBEAT, every_s=0.5)
    said = standing.texts()
    for text in ("Hold still, measuring down side", "progress <17>", "down side already completed"):
        assert f"[cal] {text}" in said
    assert said.count("[cal] down side already completed") == 2
    assert not any("done: accel" in text for text in said)


@pytest.mark.parametrize("kind", [MAG, AIRSPEED])
def test_one_that_waits_is_cancelled_by_all_zeros_and_answered_twice(standing, kind):
    ask(standing, kind)
    standing.run(5.0, HEARTBEAT, every_s=0.5)
    assert ask(standing, ()) == [0, 1]
    assert standing.texts()[-1] == "[cal] calibration cancelled"
    assert ask(standing, GYRO) == [0]


def test_while_one_is_under_way_others_and_arming_are_refused(standing):
    ask(standing, BARO)
    assert ask(standing, GYRO) == [1]
    assert ask(standing, ()) == [1], "the simulated barometer's cannot be cancelled"
    assert standing.command(ARM, 1.0) == [1]
    assert standing.texts()[-1] == "Arming denied: calibrating"


@pytest.mark.parametrize("kind", [GYRO, MAG, BARO, ACCEL, LEVEL, AIRSPEED], ids=str)
def test_unused_parameters_may_be_nan_as_mavsdk_sends_them(standing, kind):
    given = [value or math.nan for value in kind]
    assert standing.command(CALIBRATE, *given, *[math.nan] * (7 - len(given))) == [0]
    assert standing.texts()[0].startswith("[cal] calibration started")


@pytest.mark.parametrize(
    ("params", "results", "text"),
    [
        ((), [0], ""),
        ((0, 2), [0], ""),
        ((0, 0, 0, 0, 4), [0], ""),
        ((0, 0, 0, 0, 3), [], ""),
        ((math.nan,) * 7, [3], ""),
        (RADIO, [0], "Calibration: Disabling RC input"),
        (ESC, [2], "[cal] calibration failed: Disconnect battery and try again"),
    ],
)
def test_what_is_only_answered(standing, params, results, text):
    assert ask(standing, params) == results
    assert standing.texts() == ([text] if text else [])
