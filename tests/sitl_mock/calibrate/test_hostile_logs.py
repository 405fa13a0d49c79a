"""Files that are no recordings, or damaged ones, are refused by `calibrate` and `compare` at once, in words."""

import os
import struct
from pathlib import Path

import pytest

from sitl_mock.calibrate.step_log import read_step_log
from sitl_mock.compare.recording import read_tlog
from sitl_mock.errors import ConfigError
from sitl_mock.logs import dataflash, ulog

TOPIC = "vehicle_local_position"
BEGINNING = ulog.header(0) + ulog.flags()


def defined(text):
    return ulog.message("F", f"{TOPIC}:{text};".encode())


def subscribed():
    return ulog.message("A", struct.pack("<BH", 0, 1) + TOPIC.encode())


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
}


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
