"""Files that are no recordings, or damaged ones, are refused by `calibrate` and `compare` at once, in words."""

import os
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl_mock.calibrate.command import calibrate_file
from sitl_mock.calibrate.step_log import COLUMNS, read_step_log
from sitl_mock.compare.recording import read_tlog
from sitl_mock.errors import LONGEST_RECORDING_S, ConfigError
from sitl_mock.logs import dataflash, ulog
from sitl_mock.mavlink import Encoder

TOPIC = "vehicle_local_position"
BEGINNING = ulog.header(0) + ulog.flags()


def defined(text):
    return ulog.message("F", f"{TOPIC}:{text};".encode())


def subscribed():
    return ulog.message("A", struct.pack("<BH", 0, 1) + TOPIC.encode())


def record_kind(name, letters, columns, size=89):
    """A FMT record of kind 7."""
    body = struct.pack("<BB4s16s64s", 7, size, name.encode(), letters.encode(), columns.encode())
    return dataflash.START + bytes((128,)) + body


def texts(topic, fields, count):
    """A ULog whose topic has one data message of `count` letters."""
    definition = ulog.message("F", f"{topic}:{fields};".encode())
    subscription = ulog.message("A", struct.pack("<BH", 0, 1) + topic.encode())
    return (
        BEGINNING
        + definition
        + subscription
        + ulog.message("D", struct.pack("<H", 1) + b"x" * count)
    )


DAMAGED = {
    "a huge array": BEGINNING + defined("uint64_t timestamp;uint8_t[99999999999] x") + subscribed(),
    "a count of 5000 digits": BEGINNING + defined(f"uint8_t[{'9' * 5000}] x") + subscribed(),
    "a count that is a word": BEGINNING + defined("uint8_t[abc] x") + subscribed(),
    "a negative count": BEGINNING + defined("uint8_t[-5] x") + subscribed(),
    "an unknown type": BEGINNING + defined("other_topic x") + subscribed(),
    "an empty subscription": BEGINNING + defined("uint64_t timestamp") + ulog.message("A", b""),
    "data of a topic without fields": BEGINNING
    + defined("uint64_t timestamp")
    + subscribed()
    + ulog.message("D", struct.pack("<HQ", 1, 5)),
    "nothing but its magic": ulog.MAGIC,
    "definitions without end": dataflash.START + bytes((128,)) + bytes(86) * 50,
    "a record longer than any": record_kind("GUIP", "a" * 16, ",".join("abcdefghijklmnop")),
    "a text for a time": texts("vehicle_status", "char timestamp;char nav_state", 2),
    "an array for a time": texts("vehicle_land_detected", "uint8_t[4] timestamp;uint8_t landed", 5),
    "a vector of one number": texts(
        "trajectory_setpoint", "uint64_t timestamp;float[1] velocity;float[3] position", 24
    ),
    "a text for a speed": record_kind("GUIP", "QBNNN", "TimeUS,Type,vX,vY,vZ")
    + dataflash.START
    + bytes((7,))
    + bytes(57),
}

HEADER = ",".join(COLUMNS)
AT_REST = dict.fromkeys(COLUMNS, 0.0)


def step_file(path, *rows):
    """A CSV file of rows that are at rest except for the values given."""
    lines = [",".join(repr(float(value)) for value in (AT_REST | row).values()) for row in rows]
    path.write_text("\n".join((HEADER, *lines)) + "\n", encoding="utf-8")
    return path


def recorded_by(path, *heartbeats_s):
    """A .tlog of heartbeats, each with the vehicle's own clock beside it."""
    encoder = Encoder(1, 1)
    content = b""
    for at_s in heartbeats_s:
        stamp = struct.pack(">Q", 1_700_000_000_000_000 + round(at_s * 1e6))
        content += stamp + encoder.pack("HEARTBEAT", 2, 12, 81, 0, 3, 3)
        content += stamp + encoder.pack("SYSTEM_TIME", 0, round(at_s * 1e3))
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", sorted(DAMAGED))
def test_a_damaged_flight_log_is_refused_in_words(tmp_path, name):
    path = tmp_path / "flight.ulg"
    path.write_bytes(DAMAGED[name])
    with pytest.raises(ConfigError, match=r"flight\.ulg"):
        read_step_log(path)


@pytest.mark.parametrize("read", [read_step_log, read_tlog])
def test_a_pipe_and_a_device_are_refused_at_once(tmp_path, read):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (pipe, Path("/dev/zero"), tmp_path):
        with pytest.raises(ConfigError, match="no regular file"):
            read(path)


def rows_or_refusal(read, content, selection):
    """What a reader returns, or the words of its error; every other exception fails the test."""
    try:
        return read(content, selection, "flight.ulg")
    except ConfigError as error:
        return str(error)


@pytest.mark.parametrize("name", sorted(DAMAGED))
def test_a_reader_gives_rows_or_refuses_with_the_name_of_the_file(name):
    content = DAMAGED[name]
    read = ulog.read if content.startswith(ulog.MAGIC) else dataflash.read
    found = rows_or_refusal(read, content, {TOPIC: ("timestamp", "vx"), "GUIP": ("TimeUS",)})
    assert "flight.ulg" in found or found[TOPIC] == []


FIELD = st.builds(
    "{}{} {}".format,
    st.sampled_from(["float", "uint8_t", "char", "double", "other", ""]),
    st.sampled_from(["", "[2]", "[0]", "[-1]", "[70000]", "[x]", "[", f"[{'9' * 30}]"]),
    st.sampled_from(["vy", "vx", "_padding0", ""]),
)


@settings(deadline=None)
@given(fields=st.lists(FIELD, max_size=4), data=st.binary(max_size=60))
def test_a_format_is_read_or_refused_with_the_names_of_file_and_topic(fields, data):
    content = BEGINNING + defined(";".join(["uint64_t timestamp", *fields, "float vx"]))
    content += subscribed() + ulog.message("D", struct.pack("<H", 1) + data)
    found = rows_or_refusal(ulog.read, content, {TOPIC: ("timestamp", "vx")})
    if isinstance(found, str):
        assert f"flight.ulg: {'data of ' * ('cut off' in found)}topic {TOPIC}" in found
    else:
        assert [row[0] for row in found[TOPIC]] == [int.from_bytes(data[:8], "little")]


MOST = {
    name: 1e10 if name == "t_s" else 100.0 if name.endswith("_m_s") else 1e5 for name in COLUMNS
}


@pytest.mark.parametrize("times", [1.001, 1e3, 1e150, 1e297])
@pytest.mark.parametrize("column", COLUMNS)
def test_a_value_that_no_flight_has_is_refused_with_its_column_and_what_is_allowed(
    tmp_path, column, times
):
    most = MOST[column]
    rows = [{"t_s": 0.1 * number} for number in range(20)]
    rows[12][column] = -most * times
    words = rf"log\.csv, row 14, column {column}: .*; allowed are -{most:g} to {most:g}".replace(
        "+", r"\+"
    )
    with pytest.raises(ConfigError, match=words):
        calibrate_file(step_file(tmp_path / "log.csv", *rows), None, None, as_json=True)


def test_the_greatest_values_allowed_are_compared_with_numbers_that_are_finite(tmp_path):
    rows = [
        {"t_s": 1e10 - 9.0 + 0.3 * number, "cmd_n_m_s": 100.0, "vel_n_m_s": -100.0, "pos_n_m": 1e5}
        for number in range(20)
    ]
    path = step_file(tmp_path / "px4.csv", *rows)
    assert np.isfinite(read_step_log(path).time_s).all()
    assert calibrate_file(path, None, None, as_json=True, dynamics_only=True) == 1


def test_times_that_span_days_are_refused_at_once_with_the_span_that_is_allowed(tmp_path):
    rows = [{"t_s": 1e6 * number} for number in range(60)]
    words = (
        rf"log\.csv, column t_s: the times span 5\.9e\+07 s; .* at most {LONGEST_RECORDING_S:g} s"
    )
    with pytest.raises(ConfigError, match=words):
        calibrate_file(step_file(tmp_path / "log.csv", *rows), None, None, as_json=True)


def test_a_descent_for_which_the_mock_cannot_climb_high_enough_is_refused(tmp_path):
    rows = [{"t_s": float(number), "pos_d_m": 100.0 * number} for number in range(20)]
    words = r"log\.csv, row 21, column pos_d_m: 1900 m below the first row; allowed are 800 m"
    with pytest.raises(ConfigError, match=words):
        read_step_log(step_file(tmp_path / "log.csv", *rows))


def test_a_recording_whose_two_clocks_say_weeks_is_refused_at_once(tmp_path):
    with pytest.raises(ConfigError, match=r"flight\.tlog: the times span 4e\+06 s; .* at most"):
        read_tlog(recorded_by(tmp_path / "flight.tlog", 0.0, 1.0, 4e6))
    assert read_tlog(recorded_by(tmp_path / "short.tlog", 0.0, 1.0, 4e3)).end_s == pytest.approx(
        4e3
    )
