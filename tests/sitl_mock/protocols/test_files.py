"""Row 14: logs, FTP and calibrations are answered. Files are read by an independent reader; lists as the real ones'."""

import json
import lzma
import struct

import pytest
from pymavlink import mavutil  # noqa: F401 - its import sets the dialect that mavftp needs

from sitl_mock import MockVehicle
from sitl_mock.mavlink import Decoder, Encoder

HEAD = struct.Struct("<HBBBBBBI")
ACK = 128
NAK = 129


class Client:
    """A client of one vehicle's files, time by hand."""

    def __init__(self, flavour):
        self.vehicle = MockVehicle(flavour, ready_after_s=0.0)
        self.encoder = Encoder(255, 190)
        self.decoder = Decoder()
        self.now_s = 0.0
        self.sequence = 0
        self.vehicle.step(0.0)

    def send(self, *message):
        self.now_s += 0.02
        frames = self.vehicle.step(self.now_s, [self.encoder.pack(*message)])
        return [m for frame in frames for m in self.decoder.feed(frame, whole=True)]

    def ask(self, opcode, data=b"", *, size=None, offset=0):
        """One request; (sequence, opcode, offset, complete, data) of each answer."""
        self.sequence += 1
        head = HEAD.pack(
            self.sequence, 0, opcode, len(data) if size is None else size, 0, 0, 0, offset
        )
        came = self.send("FILE_TRANSFER_PROTOCOL", 0, 1, 1, (head + data).ljust(251, b"\0"))
        answers = []
        for message in came:
            if message.get_type() == "FILE_TRANSFER_PROTOCOL":
                raw = bytes(message.payload)
                sequence, _, code, length, asked, complete, _, at = HEAD.unpack_from(raw)
                assert asked == opcode
                answers.append(
                    (sequence - self.sequence, code, at, complete, raw[12 : 12 + length])
                )
        return answers

    def read(self, path):
        """A whole file, piece by piece."""
        ((_, code, _, _, size),) = self.ask(4, path)
        assert code == ACK
        content = b""
        while True:
            ((_, code, _, _, data),) = self.ask(5, size=200, offset=len(content))
            if code == NAK:
                assert data == b"\x06"
                assert len(content) == struct.unpack("<I", size)[0]
                return content
            content += data

    def entries(self, path):
        found = b""
        while True:
            ((_, code, _, _, data),) = self.ask(3, path, offset=found.count(b"\0"))
            if code == NAK:
                return [line.decode() for line in found.split(b"\0")[:-1]]
            found += data


@pytest.fixture(params=["px4", "arducopter"])
def client(request):
    return Client(request.param)


def test_row_14_folders_are_listed_and_what_is_not_there_is_not_found(client):
    root = client.entries(b"/")
    assert root == client.entries(b".")
    assert ("Dlog" if client.vehicle.flavour == "px4" else "Dterrain") in root
    ((_, code, _, _, data),) = client.ask(3, b"nosuch")
    assert (code, data) == (NAK, b"\x0a")
    ((_, code, _, _, data),) = client.ask(4, b"nosuch")
    assert (code, data) == (NAK, b"\x0a")


def told(answers):
    """The first byte of a NAK, or "ok"."""
    ((_, code, _, _, data),) = answers
    return "ok" if code == ACK else data[0]


def test_a_client_writes_reads_renames_and_removes(client):
    """As the real PX4 and ArduCopter answer (`python -m tests.witness --only MAVFTP`)."""
    assert told(client.ask(9, b"/a")) == "ok"
    assert told(client.ask(9, b"/a")) == 8
    assert told(client.ask(6, b"/nosuch/x.txt")) == 10
    assert told(client.ask(6, b"/a/x.txt")) == "ok"
    assert told(client.ask(7, b"some words")) == "ok"
    assert told(client.ask(7, b" more", offset=10)) == "ok"
    assert told(client.ask(1)) == "ok"
    assert client.read(b"/a/x.txt") == b"some words more"
    assert client.entries(b"/a") == ["Fx.txt\t15"]
    assert told(client.ask(10, b"/a")) == 2
    assert told(client.ask(12, b"/a/x.txt", offset=4)) == "ok"
    assert told(client.ask(13, b"/a/x.txt\0/a/y.txt")) == "ok"
    assert told(client.ask(8, b"/a/x.txt")) == 10
    assert client.read(b"/a/y.txt") == b"some"
    assert told(client.ask(8, b"/a/y.txt")) == "ok"
    assert told(client.ask(13, b"/a\0/b")) == "ok"
    assert told(client.ask(10, b"/b")) == "ok"
    assert told(client.ask(10, b"/b")) == 10


def test_the_vehicles_own_files_are_protected_and_the_storage_is_bounded(client):
    own = b"/tmp" if client.vehicle.flavour == "px4" else b"/terrain"
    assert told(client.ask(10, own)) == 9
    assert told(client.ask(6, b"/big")) == "ok"
    assert told(client.ask(7, b"x", offset=1 << 30)) == 2
    assert told(client.ask(12, b"/big", offset=1 << 30)) == 2
    made = [told(client.ask(9, b"/f%d" % number)) for number in range(250)]
    assert made.count("ok") == 199
    assert set(made[199:]) == {2}


def test_what_a_client_wrote_outlives_a_reboot():
    client = Client("px4")
    client.ask(6, b"/kept.txt")
    client.ask(7, b"words")
    client.vehicle.inject("reboot", value=True)
    client.now_s += 5.0
    client.vehicle.step(client.now_s)
    assert client.read(b"/kept.txt") == b"words"


def test_row_14_arducopters_packed_parameters_are_those_of_the_parameter_protocol():
    client = Client("arducopter")
    packed = client.read(b"@PARAM/param.pck")
    values = {}
    name = ""
    at = 6
    assert struct.unpack_from("<HHH", packed) == (0x671B, 1390, 1390)
    while at < len(packed):
        form = {1: "<b", 2: "<h", 3: "<i", 4: "<f"}[packed[at] & 15]
        common = packed[at + 1] & 15
        rest = (packed[at + 1] >> 4) + 1
        name = name[:common] + packed[at + 2 : at + 2 + rest].decode()
        (values[name],) = struct.unpack_from(form, packed, at + 2 + rest)
        at += 2 + rest + struct.calcsize(form)
    parameters = client.vehicle.autopilot.parameters
    assert values == {name: parameters[name] for name in parameters.names}


def test_row_14_pymavlinks_own_reader_understands_the_packed_parameters_and_their_defaults():
    from pymavlink import mavftp

    client = Client("arducopter")
    client.send("PARAM_SET", 1, 1, b"GUID_TIMEOUT", 4.5, 9)
    for path in (b"@PARAM/param.pck", b"@PARAM/param.pck?withdefaults=1"):
        read = mavftp.MAVFTP.ftp_param_decode(client.read(path))
        named = {name.decode(): value for name, value, _ in read.params}
        assert len(named) == 1390
        assert named["GUID_TIMEOUT"] == 4.5
    defaults = {name.decode(): value for name, value, _ in read.defaults}
    assert defaults["GUID_TIMEOUT"] == 3.0
    part = mavftp.MAVFTP.ftp_param_decode(client.read(b"@PARAM/param.pck?start=10&count=5"))
    assert [name for name, _, _ in part.params] == [name for name, _, _ in read.params[10:15]]


def test_arducopters_parameters_survive_a_reboot():
    client = Client("arducopter")
    client.send("PARAM_SET", 1, 1, b"WPNAV_SPEED", 600.0, 9)
    client.send("COMMAND_LONG", 1, 1, 246, 0, 1, 0, 0, 0, 0, 0, 0)
    client.now_s += 5.0
    client.vehicle.step(client.now_s)
    assert client.vehicle.autopilot.boots == 2
    came = client.send("PARAM_REQUEST_READ", 1, 1, b"WPNAV_SPEED", -1)
    assert [m.param_value for m in came if m.get_type() == "PARAM_VALUE"] == [600.0]


def test_arducopter_lists_the_files_of_its_system():
    """As the real one's simulation (`python -m tests.witness --only @SYS`)."""
    client = Client("arducopter")
    assert len(client.entries(b"@SYS")) == 11
    assert client.read(b"@SYS/tasks.txt") == b"TasksV2\n"
    assert told(client.ask(4, b"@SYS/uarts.txt")) == 10


def test_row_14_a_plan_is_read_as_mission_items():
    client = Client("arducopter")
    client.send("MISSION_COUNT", 1, 1, 1, 1)
    client.send(
        "MISSION_ITEM_INT", 1, 1, 0, 0, 5003, 0, 1, 30.0, 0, 0, 0, 470000000, 80000000, 0.0, 1
    )
    plan = client.read(b"@MISSION/fence.dat")
    assert struct.unpack_from("<HHHHH", plan) == (0x763D, 1, 0, 0, 1)
    assert len(plan) == 10 + 38
    assert struct.unpack_from("<f", plan, 10) == (30.0,)


def test_row_14_px4s_parameter_metadata_is_read():
    client = Client("px4")
    described = json.loads(lzma.decompress(client.read(b"/etc/extras/parameters.json.xz")))
    by_name = {item["name"]: item for item in described["parameters"]}
    assert len(by_name) == 897
    assert by_name["COM_OF_LOSS_T"]["max"] == 60.0


def test_a_burst_brings_the_file_in_order_and_ends():
    client = Client("arducopter")
    whole = client.read(b"@PARAM/param.pck")
    client.ask(4, b"@PARAM/param.pck")
    content = b""
    while True:
        answers = client.ask(15, size=239, offset=len(content))
        if answers[0][1] == NAK:
            break
        assert [sequence for sequence, *_ in answers] == list(range(1, len(answers) + 1))
        assert [complete for *_, complete, _ in answers] == [0] * (len(answers) - 1) + [1]
        for _, _, at, _, data in answers:
            assert at == len(content)
            content += data
    assert content == whole


def test_a_crc_is_that_of_the_file(client):
    path = (
        b"/etc/extras/parameters.json.xz"
        if client.vehicle.flavour == "px4"
        else b"@MISSION/mission.dat"
    )
    content = client.read(path)
    crc = 0
    for byte in content:  # reflected CRC-32 without inversions
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    ((_, code, _, _, data),) = client.ask(14, path)
    assert (code, struct.unpack("<I", data)) == (ACK, (crc,))
