"""Flight logs: other people's readers read them; clients list, download, stream and remove them."""

import io
import math
from itertools import pairwise

import numpy as np
import pytest
from pymavlink import DFReader
from pyulog import ULog

from sitl_mock import MockVehicle
from sitl_mock.calibrate import FlavourName, compare_log, fly_log, read_step_log
from sitl_mock.errors import ConfigError
from sitl_mock.faults import Faulted, FaultScript
from sitl_mock.logs import dataflash
from sitl_mock.logs.ulog import MAGIC
from sitl_mock.mavlink import Decoder, Encoder
from sitl_mock.serving.log_folder import LogFolder

ARM = 400
TAKE_OFF = 22
LAND = 21
SET_MODE = 176
START = 2510
STOP = 2511
NORTH_2_M_S = ("SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 1, 2503, *(0.0,) * 3, 2.0, *(0.0,) * 7)


class Flight:
    """A vehicle and its client, time by hand."""

    def __init__(self, flavour, **settings):
        self.vehicle = MockVehicle(flavour, ready_after_s=0.5, **settings)
        self.now_s = 0.0
        self.came = []
        self._encoder = Encoder(255, 190)
        self._decoder = Decoder()
        self.step(steps=100)

    def step(self, *messages, steps=1):
        """Send messages in the first of some steps; return what came."""
        frames = self.pass_by(*messages, steps=steps)
        came = [message for frame in frames for message in self._decoder.feed(frame, whole=True)]
        self.came += came
        return came

    def pass_by(self, *messages, steps=1):
        """Send messages in the first of some steps; return the frames that came, unread."""
        frames = []
        for index in range(steps):
            self.now_s += 0.02
            sent = [self._encoder.pack(*message) for message in messages] if index == 0 else []
            frames += self.vehicle.step(self.now_s, sent)
        return frames

    def command(self, number, *params):
        filled = (*params, *(0.0,) * (7 - len(params)))
        came = self.step(("COMMAND_LONG", 1, 1, number, 0, *filled), steps=2)
        return [m.result for m in came if m.get_type() == "COMMAND_ACK"]

    def fly(self):
        """Take off, fly north at 2 m/s, land and disarm."""
        if self.vehicle.flavour == "px4":
            self.command(TAKE_OFF, 0, 0, 0, math.nan, math.nan, math.nan, 493.0)
            self.command(ARM, 1)
            self.pass_by(steps=400)
            self.pass_by(NORTH_2_M_S)
            self.command(SET_MODE, 1, 6)
        else:
            self.command(SET_MODE, 1, 4)
            self.command(ARM, 1)
            self.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 5.0)
            self.pass_by(steps=400)
        for _ in range(200):
            self.pass_by(NORTH_2_M_S)
        self.command(*((LAND,) if self.vehicle.flavour == "px4" else (SET_MODE, 1, 9)))
        while self.vehicle.armed:
            self.pass_by()

    def listed(self):
        came = self.step(("LOG_REQUEST_LIST", 1, 1, 0, 0xFFFF), steps=2)
        return [m for m in came if m.get_type() == "LOG_ENTRY"]

    def downloaded(self, entry):
        content = bytearray(entry.size)
        came = self.step(("LOG_REQUEST_DATA", 1, 1, entry.id, 0, 0xFFFFFFFF), steps=60)
        for piece in came:
            if piece.get_type() == "LOG_DATA":
                content[piece.ofs : piece.ofs + piece.count] = bytes(piece.data[: piece.count])
        return bytes(content)


@pytest.fixture(scope="module")
def flights():
    flown = {}
    for flavour in ("px4", "arducopter"):
        flown[flavour] = Flight(flavour)
        flown[flavour].fly()
    return flown


@pytest.mark.parametrize("flavour", ["px4", "arducopter"])
def test_a_flight_is_listed_and_downloaded_and_its_file_is_the_same(flights, flavour):
    """Catches a download with a missing or doubled piece."""
    flown = flights[flavour]
    (entry,) = flown.listed()
    assert entry.id == (0 if flown.vehicle.flavour == "px4" else 1)
    assert abs(entry.time_utc - flown.vehicle.logs[0].changed_s) < 1.0
    assert flown.downloaded(entry) == flown.vehicle.logs[0].content[: entry.size]


def test_pyulog_reads_a_flight(flights):
    log = ULog(io.BytesIO(flights["px4"].vehicle.logs[0].content))
    assert log.msg_info_dict["sys_name"] == "PX4"
    assert log.initial_parameters["MPC_XY_VEL_MAX"] == 12.0
    assert "Landing detected" in [text.message for text in log.logged_messages]
    series = {data.name: data.data for data in log.data_list}
    assert set(series["vehicle_status"]["nav_state"]) == {4, 14, 17, 18}
    assert set(series["vehicle_status"]["arming_state"]) == {1, 2}
    assert series["vehicle_local_position"]["vx"].max() == pytest.approx(1.8, abs=0.2)
    wanted = series["trajectory_setpoint"]["velocity[0]"]
    assert np.nanmax(wanted) == 2.0
    assert series["battery_status"]["remaining"][-1] == pytest.approx(0.52, abs=0.02)
    rates_hz = {
        name: (len(data["timestamp"]) - 1) / np.ptp(data["timestamp"]) * 1e6
        for name, data in series.items()
    }
    assert rates_hz["vehicle_attitude"] == pytest.approx(20.0, rel=0.02)
    assert rates_hz["vehicle_local_position_setpoint"] == pytest.approx(10.0, rel=0.02)


def test_pyulog_finds_the_track_that_ulog2kml_draws(flights):
    """`ulog2kml` draws vehicle_gps_position, and needs simplekml, which the tests do not install."""
    log = ULog(io.BytesIO(flights["px4"].vehicle.logs[0].content))
    track = log.get_dataset("vehicle_gps_position").data
    estimated = log.get_dataset("vehicle_global_position").data
    assert track["fix_type"][-1] == 3
    north_m = (track["latitude_deg"] - track["latitude_deg"][0]) * 111_185.0
    assert north_m[-1] == pytest.approx(8.0, abs=3.0)
    assert np.abs(track["longitude_deg"] - track["longitude_deg"][0]).max() < 5e-5
    assert track["altitude_msl_m"].max() == pytest.approx(estimated["alt"].max(), abs=2.0)


def test_dfreader_reads_a_flight(flights, tmp_path):
    path = tmp_path / "flight.bin"
    path.write_bytes(flights["arducopter"].vehicle.logs[0].content)
    reader = DFReader.DFReader_binary(str(path))
    records = {}
    while (record := reader.recv_msg()) is not None:
        records.setdefault(record.get_type(), []).append(record)
    assert len(records["PARM"]) == 1390
    assert [record.Mode for record in records["MODE"]] == [4, 9]
    assert [(record.ArmState, record.Method) for record in records["ARM"]] == [(1, 1), (0, 13)]
    # Armed, armed for automatic flight, not landed, perhaps landed, landed, disarmed.
    assert [record.Id for record in records["EV"]] == [10, 15, 28, 17, 18, 11]
    texts = [record.Message for record in records["MSG"]]
    assert texts[1:] == ["Arming motors", "Disarming motors"]
    assert max(record.VN for record in records["XKF1"]) == pytest.approx(1.9, abs=0.2)
    assert {record.vX for record in records["GUIP"]} == {200.0}
    assert max(-record.PD for record in records["PSCD"]) == pytest.approx(5.0, abs=0.3)
    steps_us = [b.TimeUS - a.TimeUS for a, b in pairwise(records["ATT"])]
    assert set(steps_us) == {100_000}
    reader.close()


def arms_of(flight):
    """State and method of each record of arming in a vehicle's last log."""
    content = bytes(flight.vehicle.logs[-1].content)
    rows = dataflash.read(content, {"ARM": ("ArmState", "Method")}, "log")
    return rows["ARM"]


def test_the_log_says_who_disarmed_the_copter():
    flight = Flight("arducopter", parameters={"DISARM_DELAY": 5})
    flight.command(SET_MODE, 1, 4)
    flight.command(ARM, 1)
    flight.step(steps=300)
    assert not flight.vehicle.armed
    assert arms_of(flight) == [(1, 1), (0, 17)]
    flight.command(ARM, 1)
    flight.command(185, 1)
    assert arms_of(flight)[2:] == [(1, 1), (0, 9)]
    flight.command(ARM, 1)
    flight.command(ARM, 0)
    assert arms_of(flight)[4:] == [(1, 1), (0, 1)]


@pytest.mark.parametrize(("flavour", "suffix"), [("px4", ".ulg"), ("arducopter", ".bin")])
def test_calibrate_reads_the_commands_and_the_motion_of_a_flight(
    flights, tmp_path, flavour, suffix
):
    path = tmp_path / f"flight{suffix}"
    content = flights[flavour].vehicle.logs[0].content
    path.write_bytes(content)
    log = read_step_log(path)
    assert np.ptp(log.time_s) == pytest.approx(4.0, abs=0.6)
    assert (log.command_ned_m_s == (2.0, 0.0, 0.0)).all()
    assert log.velocity_ned_m_s[-1, 0] == pytest.approx(1.8, abs=0.3)
    assert np.gradient(log.position_ned_m[:, 0], log.time_s) == pytest.approx(
        log.velocity_ned_m_s[:, 0], abs=0.4
    )
    path.write_bytes(content[: len(content) // 3])
    with pytest.raises(ConfigError, match="no flight under velocity setpoints"):
        read_step_log(path)


def test_a_mock_flies_the_climb_of_its_own_log_again(tmp_path):
    """Catches a log whose commands or times are off.

    From the ground, and with steps that fall between the log's samples.
    """
    flight = Flight("px4", noise=False)
    for velocity, steps in (
        ((0.0, 0.0, -2.0), 50),
        ((0.0, 0.0, -2.0), 350),
        ((4.0, -3.0, -1.5), 167),
        ((-4.0, 4.0, -2.0), 183),
        ((3.0, 5.0, 0.0), 154),
    ):
        target = ("SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 1, 2503, *(0.0,) * 3, *velocity)
        for _ in range(steps):
            flight.step((*target, *(0.0,) * 5))
        if not flight.vehicle.armed:
            flight.command(SET_MODE, 1, 6)
            flight.command(ARM, 1)
    path = tmp_path / "flight.ulg"
    path.write_bytes(flight.vehicle.logs[0].content)
    log = read_step_log(path)
    assert log.position_ned_m[0, 2] < -2.0
    assert np.ptp(log.time_s) > 10.0
    comparison = compare_log(log, FlavourName.PX4, fly_log(log, FlavourName.PX4))
    assert max(comparison.rms_ned_m_s) <= 0.08


def test_a_log_is_streamed_message_by_message_as_the_definitions_are_acknowledged():
    flight = Flight("px4", log_bytes=0)
    assert flight.command(STOP) == [0]
    came = flight.step(("COMMAND_LONG", 1, 1, START, 0, *(0.0,) * 7))
    content = b""
    pieces = 0
    while (
        piece := next((m for m in came if m.get_type() == "LOGGING_DATA_ACKED"), None)
    ) is not None:
        assert piece.sequence == pieces
        pieces += 1
        content += bytes(piece.data[: piece.length])
        came = flight.step(("LOGGING_ACK", 1, 1, piece.sequence))
    assert content.startswith(MAGIC)
    flight.step(steps=20)
    assert flight.command(START) == [1]
    flight.step(steps=200)
    for data in flight.came:
        if data.get_type() == "LOGGING_DATA":
            assert data.sequence == pieces
            pieces += 1
            content += bytes(data.data[: data.length])
    log = ULog(io.BytesIO(content))
    (attitude,) = (data for data in log.data_list if data.name == "vehicle_attitude")
    assert len(attitude.data["timestamp"]) > 60
    assert flight.command(STOP) == [5, 0]
    flight.command(START)
    came = flight.step(steps=400)
    assert sum(m.get_type() == "LOGGING_DATA_ACKED" for m in came) < 60
    assert flight.command(STOP) == [0]


@pytest.mark.parametrize("flavour", ["px4", "arducopter"])
def test_a_huge_setpoint_leaves_a_gap_in_the_log_and_no_error(flavour):
    flight = Flight(flavour)
    huge = ("SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 1, 0xFC0, *(3e38,) * 3, 0.0, *(0.0,) * 7)
    flight.step(huge)
    flight.command(SET_MODE, 1, 6 if flavour == "px4" else 4)
    flight.command(ARM, 1)
    if flavour == "arducopter":
        flight.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 5.0)
        flight.step(steps=300)
    for _ in range(30):
        flight.step(huge)
    assert flight.vehicle.logs[0].content


def test_two_flights_within_a_second_have_two_logs():
    flight = Flight("px4")
    for state in (1, 0, 1, 0):
        flight.command(ARM, state)
    assert len({log.path for log in flight.vehicle.logs}) == len(flight.vehicle.logs) == 2
    assert [entry.id for entry in flight.listed()] == [0, 1]


def test_logs_are_bounded_and_erased():
    flight = Flight("px4", log_bytes=40_000)
    flight.step(steps=150)
    (log,) = flight.vehicle.logs
    assert len(log.content) == pytest.approx(40_000, abs=1000)
    flight.command(ARM, 1)
    flight.command(ARM, 0)
    assert [each.path for each in flight.vehicle.logs] != [log.path]
    flight.step(("LOG_ERASE", 1, 1))
    assert flight.listed() == []


def test_arducopter_continues_its_log_unless_a_parameter_says_otherwise_and_lists_none_in_flight():
    for rotate, count in ((0, 1), (1, 2)):
        flight = Flight("arducopter", parameters={"LOG_FILE_DSRMROT": rotate})
        for before in (0, 1):
            assert {entry.num_logs for entry in flight.listed()} == {before}
            flight.command(ARM, 1)
            flight.step(steps=20)
            came = flight.step(("LOG_REQUEST_LIST", 1, 1, 0, 0xFFFF))
            assert "Disarm for log download" in [m.text for m in came if hasattr(m, "text")]
            flight.command(ARM, 0)
        assert [entry.num_logs for entry in flight.listed()] == [count] * count


def test_logs_are_written_to_a_folder_when_they_end(tmp_path):
    flights = {"uav1": Flight("px4"), "uav2": Flight("arducopter")}
    vehicles = {
        name: Faulted(flight.vehicle, name, FaultScript()) for name, flight in flights.items()
    }
    folder = LogFolder(tmp_path / "new", vehicles)
    folder.update(0.0)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
    for flight in flights.values():
        flight.command(ARM, 1)
        flight.step(steps=20)
    flights["uav1"].command(ARM, 0)
    folder.update(0.5)
    folder.update(1.0)
    (path,) = (path for path in tmp_path.rglob("*") if path.is_file())
    assert path.read_bytes() == flights["uav1"].vehicle.logs[0].content
    assert path.suffix == ".ulg"
    folder.close()
    assert (tmp_path / "new" / "uav2" / "00000001.BIN").stat().st_size > 10_000
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="--logs"):
        LogFolder(tmp_path / "file", vehicles)
