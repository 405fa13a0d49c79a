"""What a client sees of an autopilot on the ground, one case each: a function that returns it in words.

A case leaves the vehicle as it was: disarmed, without a mission, its parameters restored.
"""

import struct
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import all as dialect

from tests.witness.client import Client, enum_name, result_name

Case = Callable[[Client], str]
CASES: dict[str, Case] = {}

UNKNOWN_COMMAND = 31999
UNKNOWN_MESSAGE = 16_000_000
INJECT_FAILURE = 420
INT32 = dialect.MAV_PARAM_TYPE_INT32
FENCE = dialect.MAV_MISSION_TYPE_FENCE
MISSION = dialect.MAV_MISSION_TYPE_MISSION


def case(title: str) -> Callable[[Case], Case]:
    """Register a case under its title."""

    def registered(function: Case) -> Case:
        CASES[title] = function
        return function

    return registered


# -- identity ----------------------------------------------------------------------------------------------------------


@case("HEARTBEAT")
def heartbeats(client: Client) -> str:
    client.gather("HEARTBEAT", 1.0)
    beats = client.gather("HEARTBEAT", 5.0)
    first = beats[0]
    return f"{round(len(beats) / 5)} Hz, type {first.type}, autopilot {first.autopilot}"


@case("AUTOPILOT_VERSION")
def version(client: Client) -> str:
    answer = client.request(148)
    message = client.wait("AUTOPILOT_VERSION") if answer == "accepted" else None
    if message is None:
        client.send.command_long_send(client.system, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)
        message = client.wait("AUTOPILOT_VERSION")
    if message is None:
        return answer
    number = message.flight_sw_version
    capabilities = message.capabilities
    return f"{number >> 24}.{number >> 16 & 255}, capabilities {capabilities:#x}"


@case("standard modes in AVAILABLE_MODES")
def standard_modes(client: Client) -> str:
    client.send.command_long_send(client.system, 1, 512, 0, 435, 0, 0, 0, 0, 0, 0)
    first = client.wait("AVAILABLE_MODES")
    if first is None:
        return "none sent"
    modes = {first.mode_index: first}
    for index in range(1, first.number_modes + 1):
        if index not in modes:
            client.send.command_long_send(client.system, 1, 512, 0, 435, index, 0, 0, 0, 0, 0)
            mode = client.wait("AVAILABLE_MODES", lambda m, index=index: m.mode_index == index)
            if mode is not None:
                modes[index] = mode
    names = sorted(
        enum_name("MAV_STANDARD_MODE", mode.standard_mode, "MAV_STANDARD_MODE_")
        for mode in modes.values()
        if mode.standard_mode
    )
    return f"{len(modes)} of {first.number_modes} modes; {', '.join(names)}"


# -- commands ----------------------------------------------------------------------------------------------------------


@case("an unknown command, LONG and INT")
def unknown_command(client: Client) -> str:
    return f"{client.command(UNKNOWN_COMMAND)}, {client.command(UNKNOWN_COMMAND, whole=True)}"


@case("DO_SET_MODE with a mode that does not exist")
def unknown_mode(client: Client) -> str:
    return client.command(176, 1, 99, 99)


@case("take-off while disarmed")
def take_off_disarmed(client: Client) -> str:
    nan = float("nan")
    return client.command(22, 0, 0, 0, nan, nan, nan, 5.0)


@case("disarming while disarmed")
def disarm(client: Client) -> str:
    return client.command(400, 0)


@case("GET_HOME_POSITION")
def home(client: Client) -> str:
    client.send.command_long_send(client.system, 1, 410, 0, 0, 0, 0, 0, 0, 0, 0)
    answers = {
        message.get_type(): message for message in client.gather("COMMAND_ACK HOME_POSITION", 2.0)
    }
    result = result_name(answers["COMMAND_ACK"].result) if "COMMAND_ACK" in answers else "no answer"
    return f"{result}, {'HOME_POSITION sent' if 'HOME_POSITION' in answers else 'nothing sent'}"


@case("REQUEST_MESSAGE")
def request_message(client: Client) -> str:
    numbers = (30, 242, 300, 435, UNKNOWN_MESSAGE)
    return "; ".join(f"{number}: {client.request(number)}" for number in numbers)


@case("SET_MESSAGE_INTERVAL: 20 Hz, an unknown message, default")
def message_interval(client: Client) -> str:
    results = [client.command(511, 30, 50_000)]
    attitudes = client.gather("ATTITUDE", 3.0)
    stamps_s = [message.time_boot_ms * 1e-3 for message in attitudes]
    rate_hz = (len(stamps_s) - 1) / max(stamps_s[-1] - stamps_s[0], 0.1) if stamps_s else 0.0
    results += [client.command(511, UNKNOWN_MESSAGE, 50_000), client.command(511, 30, 0)]
    return f"{', '.join(results)}; {5 * round(rate_hz / 5):.0f} Hz"


@case("failure injection, off and enabled: GPS lost, battery empty, battery well")
def failure_injection(client: Client) -> str:
    failures = (
        (dialect.FAILURE_UNIT_SENSOR_GPS, dialect.FAILURE_TYPE_OFF),
        (dialect.FAILURE_UNIT_SYSTEM_BATTERY, dialect.FAILURE_TYPE_OFF),
        (dialect.FAILURE_UNIT_SYSTEM_BATTERY, dialect.FAILURE_TYPE_OK),
    )
    before = client.command(INJECT_FAILURE, *failures[1])
    client.set_parameter("SYS_FAILURE_EN", bits_as_float(1), INT32)
    results = [client.command(INJECT_FAILURE, *failure) for failure in failures]
    client.set_parameter("SYS_FAILURE_EN", bits_as_float(0), INT32)
    return f"off: {before}; enabled: {', '.join(results)}"


# -- parameters --------------------------------------------------------------------------------------------------------


@case("all parameters, every fifth answer lost")
def parameter_list(client: Client) -> str:
    client.send.param_request_list_send(client.system, 1)
    values: dict[int, str] = {}
    count = 0
    heard = 0
    while (message := client.wait("PARAM_VALUE", seconds=2.0)) is not None:
        heard += 1
        count = message.param_count
        if heard % 5 and message.param_index < count:
            values[message.param_index] = message.param_id
        if message.param_index == count - 1:
            break
    lost = [index for index in range(count) if index not in values]
    for index in lost[:20]:
        client.send.param_request_read_send(client.system, 1, b"", index)
        again = client.wait("PARAM_VALUE", lambda m, index=index: m.param_index == index)
        if again is not None:
            values[index] = again.param_id
    asked = min(20, len(lost))
    return f"{asked - sum(index not in values for index in lost[:20])} of {asked} sent again"


@case("a parameter that does not exist: read, set")
def unknown_parameter(client: Client) -> str:
    def of_that_name(message: Any) -> bool:
        return bool(message.param_id == "NO_SUCH_NAME")

    client.send.param_request_read_send(client.system, 1, b"NO_SUCH_NAME", -1)
    read = client.wait("PARAM_VALUE PARAM_ERROR", of_that_name, seconds=2.0)
    client.send.param_set_send(client.system, 1, b"NO_SUCH_NAME", 1.0, 9)
    written = client.wait("PARAM_VALUE PARAM_ERROR", of_that_name, seconds=2.0)
    return f"{type_of(read)}, {type_of(written)}"


# -- missions ----------------------------------------------------------------------------------------------------------


def mission_item(
    client: Client, sequence: int, command: int, kind: int = MISSION, **more: Any
) -> None:
    """Send one item 100 m north of PX4's usual home."""
    values = {"param1": 0.0, "frame": 6, "z": 20.0, "x": 473_986_000, "y": 85_455_940} | more
    client.send.mission_item_int_send(
        client.system,
        1,
        sequence,
        values["frame"],
        command,
        0,
        1,
        values["param1"],
        0.0,
        0.0,
        0.0,
        values["x"],
        values["y"],
        values["z"],
        kind,
    )


def uploaded(
    client: Client,
    commands: list[int],
    kind: int = MISSION,
    ignore: frozenset[int] = frozenset(),
    **more: Any,
) -> str:
    """Upload items, with the first request of some sequence numbers ignored; return how it ended."""
    client.send.mission_count_send(client.system, 1, len(commands), kind)
    ignored = set[int]()
    while True:
        message = client.wait(
            "MISSION_REQUEST_INT MISSION_REQUEST MISSION_ACK",
            lambda message: message.mission_type == kind,
            seconds=6.0,
        )
        if message is None:
            return "no answer"
        if message.get_type() == "MISSION_ACK":
            return enum_name("MAV_MISSION_RESULT", message.type, "MAV_MISSION_")
        if message.seq in ignore and message.seq not in ignored:
            ignored.add(message.seq)
            continue
        mission_item(client, message.seq, commands[message.seq], kind, **more)


def downloaded(client: Client, kind: int = MISSION) -> list[int]:
    """Download a plan as a client should; return the commands of its items."""
    client.send.mission_request_list_send(client.system, 1, kind)
    count = client.wait("MISSION_COUNT")
    commands = []
    for sequence in range(0 if count is None else count.count):
        client.send.mission_request_int_send(client.system, 1, sequence, kind)
        item = client.wait("MISSION_ITEM_INT", lambda m, sequence=sequence: m.seq == sequence)
        commands.append(-1 if item is None else item.command)
    client.send.mission_ack_send(client.system, 1, 0, kind)
    return commands


def cleared(client: Client, kind: int = MISSION) -> str:
    """Remove a plan; return the answer."""
    client.send.mission_clear_all_send(client.system, 1, kind)
    answer = client.wait("MISSION_ACK", lambda message: message.mission_type == kind)
    if answer is None:
        return "no answer"
    return enum_name("MAV_MISSION_RESULT", answer.type, "MAV_MISSION_")


@case("a mission of 4 items, the request of item 2 lost")
def lossy_mission(client: Client) -> str:
    result = uploaded(client, [22, 16, 16, 21], ignore=frozenset({2}))
    stored = downloaded(client)
    return f"{result}; {len(stored)} stored, commands {stored}; cleared: {cleared(client)}"


@case("a mission cleared while it is downloaded")
def cleared_in_download(client: Client) -> str:
    uploaded(client, [22, 16, 21])
    client.send.mission_request_list_send(client.system, 1, MISSION)
    client.wait("MISSION_COUNT")
    result = cleared(client)
    client.send.mission_ack_send(client.system, 1, 0, MISSION)
    client.gather("MISSION_ACK", 1.0)
    return f"{result}; after the download: {cleared(client)}"


@case("a mission with an unknown command")
def bad_mission(client: Client) -> str:
    result = uploaded(client, [22, UNKNOWN_COMMAND])
    cleared(client)
    return result


@case("a fence of two corners")
def bad_fence(client: Client) -> str:
    corner = dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    result = uploaded(client, [corner, corner], FENCE, param1=2.0, frame=0, z=0.0)
    cleared(client, FENCE)
    return result


@case("an item that nobody asked for")
def stray_item(client: Client) -> str:
    mission_item(client, 0, 16)
    answer = client.wait("MISSION_ACK MISSION_REQUEST_INT", seconds=2.0)
    if answer is None or answer.get_type() != "MISSION_ACK":
        return type_of(answer)
    return f"MISSION_ACK, {enum_name('MAV_MISSION_RESULT', answer.type, 'MAV_MISSION_')}"


# -- files, logs, time, shell ------------------------------------------------------------------------------------------


class FileAnswer(NamedTuple):
    """An answer of the autopilot's file server."""

    opcode: int
    data: bytes

    def __str__(self) -> str:
        if self.opcode == 128:
            return "ok"
        return f"refused ({'.'.join(str(code) for code in self.data)})"


def file_request(client: Client, opcode: int, data: bytes, number: int) -> FileAnswer | None:
    """Send one request of MAVFTP; return the answer."""
    payload = struct.pack("<HBBBBBBI", number, 0, opcode, len(data), 0, 0, 0, 0) + data
    client.send.file_transfer_protocol_send(0, client.system, 1, payload.ljust(251, b"\0"))
    answer = client.wait("FILE_TRANSFER_PROTOCOL", lambda message: message.payload[5] == opcode)
    if answer is None:
        return None
    content = bytes(answer.payload)
    return FileAnswer(content[3], content[12 : 12 + content[4]])


@case("MAVFTP: a file that does not exist; a folder made, made again, renamed and removed")
def folders(client: Client) -> str:
    file_request(client, 2, b"", 1)
    answers = [
        file_request(client, 4, b"/no_such_file", 3),
        file_request(client, 9, b"/witness_a", 5),
        file_request(client, 9, b"/witness_a", 7),
        file_request(client, 13, b"/witness_a\0/witness_b", 9),
        file_request(client, 10, b"/witness_b", 11),
        file_request(client, 10, b"/witness_b", 13),
    ]
    return ", ".join(str(answer) for answer in answers)


@case(
    "MAVFTP: a file made, written, closed, summed, renamed, its old name removed, its new one removed"
)
def written_file(client: Client) -> str:
    file_request(client, 2, b"", 21)
    answers = [
        file_request(client, 6, b"/witness.txt", 23),
        file_request(client, 7, b"some words", 25),
        file_request(client, 1, b"", 27),
        file_request(client, 14, b"/witness.txt", 29),
        file_request(client, 13, b"/witness.txt\0/witness.old", 31),
        file_request(client, 8, b"/witness.txt", 33),
        file_request(client, 8, b"/witness.old", 35),
    ]
    checksum = answers[3]
    shown = "" if checksum is None else checksum.data.hex()
    return f"{', '.join(str(answer) for answer in answers)}; sum {shown}"


@case(
    "MAVFTP: written without a file; a file in a folder that does not exist; a full folder removed"
)
def wrong_files(client: Client) -> str:
    file_request(client, 2, b"", 41)
    answers = [
        file_request(client, 7, b"some words", 43),
        file_request(client, 6, b"/no_such_folder/witness.txt", 45),
        file_request(client, 9, b"/witness_c", 47),
        file_request(client, 6, b"/witness_c/witness.txt", 49),
        file_request(client, 1, b"", 51),
        file_request(client, 10, b"/witness_c", 53),
        file_request(client, 8, b"/witness_c/witness.txt", 55),
        file_request(client, 10, b"/witness_c", 57),
    ]
    return ", ".join(str(answer) for answer in answers)


@case("LOG_REQUEST_LIST")
def log_list(client: Client) -> str:
    client.send.log_request_list_send(client.system, 1, 0, 0xFFFF)
    entry = client.wait("LOG_ENTRY", seconds=4.0)
    client.send.log_request_end_send(client.system, 1)
    if entry is None:
        return "no answer"
    return "some logs" if entry.num_logs else "no logs"


@case("TIMESYNC")
def timesync(client: Client) -> str:
    client.send.timesync_send(0, 123_456_789)
    answer = client.wait("TIMESYNC", lambda message: message.ts1 == 123_456_789)
    return "no answer" if answer is None else "answered"


@case("PX4's shell: ver all")
def shell(client: Client) -> str:
    line = b"ver all\n"
    client.send.serial_control_send(10, 6, 0, 0, len(line), line.ljust(70, b"\0"))
    answer = client.wait("SERIAL_CONTROL", seconds=2.0)
    return "no answer" if answer is None else "answered"


def bits_as_float(value: int) -> float:
    """Return the float whose bits are an integer's, as PX4 encodes integer parameters."""
    number: float = struct.unpack("<f", struct.pack("<i", value))[0]
    return number


def type_of(message: Any | None) -> str:
    """Return a message's name."""
    return "no answer" if message is None else str(message.get_type())
