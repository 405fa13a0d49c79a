"""What a client sees of an autopilot on the ground, one case each: a function that returns it in words.

A case leaves the vehicle as it was: disarmed, without a mission, its parameters restored. `LAST` reboots it.
"""

import re
import struct
import time
from collections.abc import Callable
from functools import partial
from itertools import count
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import all as dialect

from tests.witness.client import Client, enum_name, result_name

Case = Callable[[Client], str]
CASES: dict[str, Case] = {}
LAST: dict[str, Case] = {}
"""Played after all other cases."""

UNKNOWN_COMMAND = 31999
UNKNOWN_MESSAGE = 16_000_000
INJECT_FAILURE = 420
INT32 = dialect.MAV_PARAM_TYPE_INT32
FENCE = dialect.MAV_MISSION_TYPE_FENCE
MISSION = dialect.MAV_MISSION_TYPE_MISSION
RALLY = dialect.MAV_MISSION_TYPE_RALLY


def case(title: str, cases: dict[str, Case] = CASES) -> Callable[[Case], Case]:
    """Register a case under its title."""

    def registered(function: Case) -> Case:
        cases[title] = function
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
    return "; ".join(f"{number}: {requested_often(client, number)}" for number in numbers)


def requested_often(client: Client, number: int) -> str:
    """Request a message; PX4 denies one whose stream has just sent it, so ask up to six times."""
    answer = client.request(number)
    for _ in range(5):
        if answer != "denied":
            break
        answer = client.request(number)
    return answer


@case("SET_MESSAGE_INTERVAL: 20 Hz, an unknown message, default")
def message_interval(client: Client) -> str:
    results = [client.command(511, 30, 50_000)]
    attitudes = client.gather("ATTITUDE", 3.0)
    stamps_s = [message.time_boot_ms * 1e-3 for message in attitudes]
    rate_hz = (len(stamps_s) - 1) / max(stamps_s[-1] - stamps_s[0], 0.1) if stamps_s else 0.0
    results += [client.command(511, UNKNOWN_MESSAGE, 50_000), client.command(511, 30, 0)]
    return f"{', '.join(results)}; {5 * round(rate_hz / 5):.0f} Hz"


ALL_INTERVALS = "SET_MESSAGE_INTERVAL of every message of the dialect `all`"
ALL_STREAMS = "every accepted message at 5 Hz: those that come on the ground"


@case(ALL_INTERVALS)
def accepted_intervals(client: Client) -> str:
    """Ask for the default interval; after it no stream differs."""
    accepted = accepted_messages(client, 0)
    bring_texts(client)
    return f"{len(accepted)} accepted: {', '.join(map(str, accepted))}"


TEXT_US = 50_000


def bring_texts(client: Client) -> None:
    """Let PX4 send texts again: asking for their default interval stops them."""
    client.command(511, dialect.MAVLINK_MSG_ID_STATUSTEXT, TEXT_US)


@case(ALL_STREAMS)
def streams_of_all(client: Client) -> str:
    accepted = accepted_messages(client, 200_000)
    came = set()
    end_s = time.monotonic() + 5.0
    while (left_s := end_s - time.monotonic()) > 0.0:
        message = client.receive(left_s)
        if message is not None:
            came.add(message.get_msgId())
    for number in accepted:
        client.command(511, number, 0)
    bring_texts(client)
    # The autopilot also sends a parameter that it saves by itself, such as the declination at its first position.
    came.discard(dialect.MAVLINK_MSG_ID_PARAM_VALUE)
    return ", ".join(str(number) for number in accepted if number in came)


def accepted_messages(client: Client, interval_us: int) -> list[int]:
    """Set one interval for every message of the dialect; return those that are accepted."""
    return [
        number
        for number in sorted(dialect.mavlink_map)
        if client.command(511, number, interval_us) == "accepted"
    ]


UNITS = (*range(9), *range(100, 106))
"""FAILURE_UNIT: sensors from 0, systems from 100."""
BATTERY = dialect.FAILURE_UNIT_SYSTEM_BATTERY
TYPES = 8


def injected(client: Client, *failure: int) -> str:
    """Inject a failure; return the answer, which comes at once or not at all."""
    client.send.command_long_send(
        client.system, 1, INJECT_FAILURE, 0, *failure, *[0] * (7 - len(failure))
    )
    answer = client.wait(
        "COMMAND_ACK", lambda message: message.command == INJECT_FAILURE, seconds=0.3
    )
    return "no answer" if answer is None else result_name(answer.result)


@case("failure injection: off; every unit and type; instances of motors and the battery")
def failure_injection(client: Client) -> str:
    """The empty battery comes last and is well at once: on the ground PX4 stops when it stays empty."""
    client.set_parameter("SYS_FAILURE_EN", bits_as_float(0), INT32)
    client.gather("HEARTBEAT", 1.0)
    shown = [f"off: {client.command(INJECT_FAILURE, dialect.FAILURE_UNIT_SENSOR_GPS, 1)}"]
    client.set_parameter("SYS_FAILURE_EN", bits_as_float(1), INT32)
    client.gather("HEARTBEAT", 1.0)
    failures = [
        (unit, kind) for unit in UNITS for kind in range(TYPES) if (unit, kind) != (BATTERY, 1)
    ]
    answers = {failure: injected(client, *failure) for failure in failures}
    if len(set(answers.values())) == 1:
        shown.append(f"all: {answers[BATTERY, 0]}")
    else:
        for result, unit in sorted({(answers[unit, kind], unit) for unit, kind in failures}):
            kinds = [kind for kind in range(TYPES) if answers.get((unit, kind)) == result]
            if result != "no answer":
                shown.append(f"unit {unit}, types {kinds}: {result}")
    motor = dialect.FAILURE_UNIT_SYSTEM_MOTOR
    shown.append(
        f"motors 8 and 9: {injected(client, motor, 0, 8)}, {injected(client, motor, 0, 9)}"
    )
    shown.append(f"battery 1: {injected(client, BATTERY, 0, 1)}")
    shown.append(f"empty, well: {injected(client, BATTERY, 1)}, {injected(client, BATTERY, 0)}")
    return "; ".join(shown)


@case("SYS_STATUS at rest: present, enabled, health; battery")
def sensors(client: Client) -> str:
    client.command(511, 1, 500_000)
    client.gather("SYS_STATUS", 3.0)
    status = client.wait("SYS_STATUS")
    client.command(511, 1, 0)
    if status is None:
        return "none sent"
    bits = (
        status.onboard_control_sensors_present,
        status.onboard_control_sensors_enabled,
        status.onboard_control_sensors_health,
    )
    shown = ", ".join(f"{value:#x}" for value in bits)
    return f"{shown}; {status.voltage_battery / 1e3:.1f} V, {status.battery_remaining} %"


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
    client: Client,
    sequence: int,
    command: int,
    kind: int = MISSION,
    odd: dict[str, Any] | None = None,
    **more: Any,
) -> None:
    """Send one item 100 m north of PX4's usual home; as item 1 an odd one, if given."""
    values = {"frame": 6, "z": 20.0, "x": 473_986_000, "y": 85_455_940} | more
    parameters = (values.get("param1", 0.0), 0.0, 0.0, 0.0)
    if odd is not None and sequence == 1:
        values["frame"] = odd["frame"]
        parameters = odd["parameters"]
    client.send.mission_item_int_send(
        client.system,
        1,
        sequence,
        values["frame"],
        command,
        values.get("current", 0),
        1,
        *parameters,
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
    marked: int | None = None,
    **more: Any,
) -> str:
    """Upload items, one marked as current, some first requests ignored; return how it ended."""
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
        current = int(message.seq == marked)
        mission_item(
            client, message.seq, commands[message.seq], kind, **({"current": current} | more)
        )


def downloaded(client: Client, kind: int = MISSION) -> list[int]:
    """Download a plan as a client should; return the commands of its items."""
    return [-1 if item is None else item.command for item in items_of(client, kind)]


def items_of(client: Client, kind: int = MISSION) -> list[Any | None]:
    """Download a plan as a client should; return its items, None for one that did not come."""
    client.send.mission_request_list_send(client.system, 1, kind)
    number = client.wait("MISSION_COUNT")
    items = []
    for sequence in range(0 if number is None else number.count):
        client.send.mission_request_int_send(client.system, 1, sequence, kind)
        items.append(
            client.wait("MISSION_ITEM_INT", lambda m, sequence=sequence: m.seq == sequence)
        )
    client.send.mission_ack_send(client.system, 1, 0, kind)
    return items


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


@case(
    "the present item after missions of 4, item 2 set, the same, another 5, 5 with item 1 current, 2"
)
def replaced_missions(client: Client) -> str:
    cleared(client)
    shown = []
    missions: tuple[tuple[list[int], int | None], ...] = (
        ([22, 16, 16, 21], None),
        ([22, 16, 16, 21], None),
        ([22, 16, 17, 16, 21], None),
        ([22, 16, 16, 16, 21], 1),
        ([22, 21], None),
    )
    for number, (commands, marked) in enumerate(missions):
        uploaded(client, commands, marked=marked)
        client.gather("MISSION_CURRENT", 1.0)
        if number == 0:
            client.send.mission_set_current_send(client.system, 1, 2)
        client.gather("MISSION_CURRENT", 1.5)
        client.send.command_long_send(client.system, 1, 512, 0, 42, 0, 0, 0, 0, 0, 0)
        current = client.wait("MISSION_CURRENT")
        shown.append("none" if current is None else f"{current.seq}")
    cleared(client)
    return ", ".join(shown)


@case(
    "missions that begin with a landing, have a take-off last, or take off to below home, and MISSION_START"
)
def unflyable_missions(client: Client) -> str:
    shown = []
    for commands, height_m in (([21], 0.0), ([16, 22], 20.0), ([22, 16], -3.0)):
        result = uploaded(client, commands, z=height_m)
        client.gather("HEARTBEAT", 0.5)
        shown.append(f"{result}, {client.command(300, 0, 0)}")
    cleared(client)
    client.command(176, 1, 4 if client.autopilot == dialect.MAV_AUTOPILOT_PX4 else 0, 3)
    return "; ".join(shown)


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


ODD_ITEMS = (
    {"command": 16, "frame": 0, "parameters": (1.5, 2.5, 3.5, -90.0)},
    {"command": 17, "frame": 3, "parameters": (1.5, 2.5, -3.5, 400.0)},
    {"command": 19, "frame": 6, "parameters": (1.5, 2.5, 3.5, 45.5)},
    {"command": 21, "frame": 6, "parameters": (1.5, 2.5, 3.5, 45.5)},
    {"command": 31, "frame": 6, "parameters": (1.5, -2.5, 3.5, 45.5)},
    {"command": 177, "frame": 2, "parameters": (1.0, -1.0, 0.0, 0.0)},
    {"command": 178, "frame": 2, "parameters": (1.0, 7.25, -1.0, 0.0)},
)
"""Items of which the autopilots keep a part."""


@case("odd items, as they are downloaded: command, frame and parameters")
def odd_items(client: Client) -> str:
    words = []
    for odd in ODD_ITEMS:
        result = uploaded(client, [22, odd["command"]], odd=odd)
        stored = items_of(client)[-1]
        cleared(client)
        if result != "accepted" or stored is None:
            words.append(f"{odd['command']}: {result}")
            continue
        values = (stored.param1, stored.param2, stored.param3, stored.param4)
        numbers = " ".join(f"{value:g}" for value in values)
        words.append(f"{stored.command} ({stored.frame}): {numbers}")
    return "; ".join(words)


@case("an item that nobody asked for")
def stray_item(client: Client) -> str:
    mission_item(client, 0, 16)
    answer = client.wait("MISSION_ACK MISSION_REQUEST_INT", seconds=2.0)
    if answer is None or answer.get_type() != "MISSION_ACK":
        return type_of(answer)
    return f"MISSION_ACK, {enum_name('MAV_MISSION_RESULT', answer.type, 'MAV_MISSION_')}"


# -- files -------------------------------------------------------------------------------------------------------------


class FileAnswer(NamedTuple):
    """An answer of the autopilot's file server."""

    opcode: int
    data: bytes

    def __str__(self) -> str:
        if self.opcode == 128:
            return "ok"
        return f"refused ({'.'.join(str(code) for code in self.data)})"


_ACK = 128
_numbers = count(1, 2)


def file_request(
    client: Client, opcode: int, data: bytes, *, offset: int = 0, size: int | None = None
) -> FileAnswer | None:
    """Send one request of MAVFTP; return the answer."""
    length = len(data) if size is None else size
    number = next(_numbers) & 0xFFFF
    payload = struct.pack("<HBBBBBBI", number, 0, opcode, length, 0, 0, 0, offset) + data
    client.send.file_transfer_protocol_send(0, client.system, 1, payload.ljust(251, b"\0"))
    answer = client.wait("FILE_TRANSFER_PROTOCOL", lambda message: message.payload[5] == opcode)
    if answer is None:
        return None
    content = bytes(answer.payload)
    return FileAnswer(content[3], content[12 : 12 + content[4]])


FileRequest = tuple[int, bytes]
"""Number of an operation of MAVFTP, and its data."""
_OPEN = 4
_CLOSE = 1
_CREATE = 6
_WRITE = 7
_REMOVE = 8
_MAKE_FOLDER = 9
_REMOVE_FOLDER = 10
_RENAME = 13
_SUM = 14

FILE_CASES: dict[str, tuple[FileRequest, ...]] = {
    "MAVFTP: a file that does not exist; a folder made, made again, renamed and removed": (
        (_OPEN, b"/no_such_file"),
        (_MAKE_FOLDER, b"/witness_a"),
        (_MAKE_FOLDER, b"/witness_a"),
        (_RENAME, b"/witness_a\0/witness_b"),
        (_REMOVE_FOLDER, b"/witness_b"),
        (_REMOVE_FOLDER, b"/witness_b"),
    ),
    "MAVFTP: a file made, written, closed, summed, renamed, its old name removed, its new one removed": (
        (_CREATE, b"/witness.txt"),
        (_WRITE, b"some words"),
        (_CLOSE, b""),
        (_SUM, b"/witness.txt"),
        (_RENAME, b"/witness.txt\0/witness.old"),
        (_REMOVE, b"/witness.txt"),
        (_REMOVE, b"/witness.old"),
    ),
    "MAVFTP: written without a file; a file in a folder that does not exist; a full folder removed": (
        (_WRITE, b"some words"),
        (_CREATE, b"/no_such_folder/witness.txt"),
        (_MAKE_FOLDER, b"/witness_c"),
        (_CREATE, b"/witness_c/witness.txt"),
        (_CLOSE, b""),
        (_REMOVE_FOLDER, b"/witness_c"),
        (_REMOVE, b"/witness_c/witness.txt"),
        (_REMOVE_FOLDER, b"/witness_c"),
    ),
}
"""Cases that send one request after the other and tell each answer."""


def requested(client: Client, requests: tuple[FileRequest, ...]) -> str:
    """Send requests in order after a reset of the sessions; return the answers, a sum with its value."""
    file_request(client, 2, b"")
    answers = []
    for opcode, data in requests:
        answer = file_request(client, opcode, data)
        answers.append(f"sum {answer.data.hex()}" if answer and opcode == _SUM else str(answer))
    return ", ".join(answers)


for title, requests in FILE_CASES.items():
    CASES[title] = partial(requested, requests=requests)


def file_content(client: Client, path: bytes, most_bytes: int = 100_000) -> bytes | None:
    """Read a file's beginning over MAVFTP; None if it cannot be opened."""
    file_request(client, 2, b"")
    opened = file_request(client, _OPEN, path)
    if opened is None or opened.opcode != _ACK:
        return None
    content = b""
    while len(content) < most_bytes:
        piece = file_request(client, 5, b"", offset=len(content), size=200)
        if piece is None or piece.opcode != _ACK:
            break
        content += piece.data
    file_request(client, _CLOSE, b"")
    return content


def folder_entries(client: Client, path: bytes) -> list[str]:
    """List a folder over MAVFTP: the names of its entries."""
    entries: list[str] = []
    while True:
        answer = file_request(client, 3, path, offset=len(entries))
        if answer is None or answer.opcode != _ACK:
            return [entry.partition("\t")[0] for entry in entries]
        entries += [entry for entry in answer.data.decode().split("\0") if entry]


@case("MAVFTP: @SYS, and which of its files can be read")
def system_files(client: Client) -> str:
    names = [entry[1:] for entry in folder_entries(client, b"@SYS")]
    read = [name for name in names if file_content(client, f"@SYS/{name}".encode()) is not None]
    return f"{', '.join(names) or 'no files'}; read: {', '.join(read) or 'none'}"


@case("MAVFTP: param.pck with defaults, GUID_TIMEOUT changed")
def packed_defaults(client: Client) -> str:
    from pymavlink.mavftp import (
        MAVFTP,  # its import settles pymavlink's dialect, which the client sets
    )

    client.set_parameter("GUID_TIMEOUT", 4.5, dialect.MAV_PARAM_TYPE_REAL32)
    content = file_content(client, b"@PARAM/param.pck?withdefaults=1")
    client.set_parameter("GUID_TIMEOUT", 3.0, dialect.MAV_PARAM_TYPE_REAL32)
    packed = None if content is None else MAVFTP.ftp_param_decode(content)
    if packed is None:
        return "no file"
    values = {name.decode(): value for name, value, _ in packed.params}
    defaults = {name.decode(): value for name, value, _ in packed.defaults}
    return f"value {values['GUID_TIMEOUT']}, default {defaults['GUID_TIMEOUT']}"


# -- logs --------------------------------------------------------------------------------------------------------------


@case("LOG_REQUEST_LIST before the first arming")
def log_list(client: Client) -> str:
    return logs_in_words(listed_logs(client))


def listed_logs(client: Client) -> list[Any]:
    """Return the entries of the list of logs."""
    client.send.log_request_list_send(client.system, 1, 0, 0xFFFF)
    entries = []
    while (entry := client.wait("LOG_ENTRY", seconds=2.0)) is not None:
        entries.append(entry)
        if len(entries) >= entry.num_logs:
            break
    client.send.log_request_end_send(client.system, 1)
    return entries


def logs_in_words(entries: list[Any]) -> str:
    """Return ids and numbers of listed logs."""
    if not entries:
        return "no answer"
    return ", ".join(f"id {entry.id} of {entry.num_logs}" for entry in entries)


@case(
    "a log while armed on the ground, and after it: listed, its beginning by LOG_REQUEST_DATA and MAVFTP"
)
def flight_log(client: Client) -> str:
    armed = client.arm()
    client.gather("HEARTBEAT", 2.0)
    during = listed_logs(client)
    client.command(400, 0)
    client.gather("HEARTBEAT", 2.0)
    after = listed_logs(client)
    beginning = b"" if not after else log_beginning(client, after[0].id)
    kind = "ULog" if beginning.startswith(b"ULog") else beginning[:3].hex()
    path = newest_log(client)
    same = path is not None and file_content(client, path, 400) == beginning
    return (
        f"{armed}; armed: {logs_in_words(during)}; then {logs_in_words(after)}, {kind}, "
        f"{'the same' if same else 'not the same'} by MAVFTP"
    )


def log_beginning(client: Client, log_id: int) -> bytes:
    """Return the first 400 bytes of a log."""
    content = bytearray(400)
    client.send.log_request_data_send(client.system, 1, log_id, 0, len(content))
    for at in range(0, len(content), 90):
        piece = client.wait("LOG_DATA", lambda message, at=at: message.ofs == at)
        if piece is not None:
            content[at : at + piece.count] = bytes(piece.data[: piece.count])
    client.send.log_request_end_send(client.system, 1)
    return bytes(content[:400])


def newest_log(client: Client) -> bytes | None:
    """Return the path of the last log in the autopilot's folder of logs."""
    folders = [b"/log/" + name[1:].encode() for name in folder_entries(client, b"/log")]
    for folder in (*(folder for folder in folders if len(folder) > len(b"/log/")), b"/logs"):
        names = [name[1:] for name in folder_entries(client, folder)]
        logs = sorted(name for name in names if name.endswith((".ulg", ".BIN")))
        if logs:
            return folder + b"/" + logs[-1].encode()
    return None


@case("LOGGING_START, again, definitions acknowledged, data; LOGGING_STOP, again")
def log_stream(client: Client) -> str:
    started = client.command(2510)
    pieces = {"LOGGING_DATA_ACKED": 0, "LOGGING_DATA": 0}
    again = ""
    while (piece := client.wait(" ".join(pieces), seconds=1.0)) is not None:
        pieces[piece.get_type()] += 1
        if piece.get_type() == "LOGGING_DATA_ACKED":
            client.send.logging_ack_send(client.system, 1, piece.sequence)
        elif not again:
            again = client.command(2510)
        elif pieces["LOGGING_DATA"] > 20:
            break
    stopped = client.command(2511)
    client.gather("COMMAND_ACK", 1.0)
    came = [name for name, count in pieces.items() if count > 20]
    return f"{started}, {again or '-'}; {', '.join(came) or 'nothing'}; {stopped}, {client.command(2511)}"


# -- lost heartbeats, signing ------------------------------------------------------------------------------------------

SILENCE_S = 20.0
"""PX4 misses a ground station after COM_DL_LOSS_T, 10 s."""
KEY = bytes(range(32))


@case("no HEARTBEAT of the ground station for 20 s, disarmed: texts, and texts when it is back")
def silent_station(client: Client) -> str:
    client.gather("STATUSTEXT", 2.0)
    client.is_silent = True
    lost = texts_of(client.gather("STATUSTEXT", SILENCE_S))
    client.is_silent = False
    back = texts_of(client.gather("STATUSTEXT", 4.0))
    return f"{', '.join(lost) or 'none'}; {', '.join(back) or 'none'}"


@case("SETUP_SIGNING: HEARTBEAT, an unsigned and a signed command, HEARTBEAT after an empty key")
def signing(client: Client) -> str:
    since_2015_s = time.time() - 1_420_070_400.0
    stamp = int(since_2015_s * 1e5)
    client.send.setup_signing_send(client.system, 1, KEY, stamp)
    client.drain()
    client.gather("HEARTBEAT", 1.0)
    shown = [signature_of(client), client.command(410)]
    client.link.setup_signing(KEY, sign_outgoing=True, allow_unsigned_callback=lambda *_: True)
    shown.append(client.command(410))
    client.send.setup_signing_send(client.system, 1, bytes(32), 0)
    client.link.disable_signing()
    client.gather("HEARTBEAT", 1.0)
    shown.append(signature_of(client))
    return ", ".join(shown)


def signature_of(client: Client) -> str:
    """Return whether the next HEARTBEAT is signed."""
    beat = client.wait("HEARTBEAT")
    if beat is None:
        return "no HEARTBEAT"
    return "signed" if beat.get_header().incompat_flags & 1 else "unsigned"


# -- what ArduPilot's own tests wait for ------------------------------------------------------------------------------

PREARM_CHECK = dialect.MAV_SYS_STATUS_PREARM_CHECK
GPS = dialect.MAV_SYS_STATUS_SENSOR_GPS
RUN_PREARM_CHECKS = 401
EKF_WANTED = (
    dialect.EKF_ATTITUDE
    | dialect.EKF_VELOCITY_HORIZ
    | dialect.EKF_VELOCITY_VERT
    | dialect.EKF_POS_HORIZ_REL
    | dialect.EKF_POS_HORIZ_ABS
    | dialect.EKF_POS_VERT_ABS
    | dialect.EKF_PRED_POS_HORIZ_REL
    | dialect.EKF_PRED_POS_HORIZ_ABS
)
EKF_ERRORS = (
    dialect.EKF_CONST_POS_MODE | dialect.ESTIMATOR_ACCEL_ERROR | dialect.ESTIMATOR_GPS_GLITCH
)


def has_bit(status: Any, bit: int) -> str:
    """Return what SYS_STATUS says of a sensor: present, enabled, healthy."""
    words = {
        "present": status.onboard_control_sensors_present,
        "enabled": status.onboard_control_sensors_enabled,
        "healthy": status.onboard_control_sensors_health,
    }
    return " ".join(word for word, bits in words.items() if bits & bit) or "absent"


@case("wait_ready_to_arm of ArduPilot's tests: EKF flags, GPS, home, the bit of the pre-arm checks")
def ready_to_arm(client: Client) -> str:
    client.command(511, 193, 500_000)  # EKF_STATUS_REPORT
    client.command(511, 1, 500_000)
    client.gather("HEARTBEAT", 1.0)
    report = client.wait(
        "EKF_STATUS_REPORT",
        lambda m: m.flags & EKF_WANTED == EKF_WANTED and not m.flags & EKF_ERRORS,
    )
    status = client.wait("SYS_STATUS")
    client.send.command_long_send(client.system, 1, 410, 0, 0, 0, 0, 0, 0, 0, 0)
    position = client.wait("HOME_POSITION")
    client.command(511, 193, 0)
    client.command(511, 1, 0)
    flags = "no EKF_STATUS_REPORT" if report is None else f"EKF {report.flags:#x}"
    place = "no home" if position is None else "home"
    return f"{flags}; GPS {has_bit(status, GPS)}; {place}; checks {has_bit(status, PREARM_CHECK)}"


@case(
    "assert_prearm_failure of ArduPilot's tests: checks with a good and a bad parameter, arming with the bad one"
)
def prearm_failure(client: Client) -> str:
    if client.autopilot == dialect.MAV_AUTOPILOT_PX4:
        name = "COM_ARM_MIS_REQ"
        bad = bits_as_float(1)
        kind = INT32
    else:
        name = "ANGLE_MAX"
        bad = 500.0
        kind = dialect.MAV_PARAM_TYPE_INT16
    good = client.read_parameter(name)
    client.gather("STATUSTEXT", 1.0)
    shown = [answer_and_texts(client, RUN_PREARM_CHECKS)]
    client.set_parameter(name, bad, kind)
    client.gather("STATUSTEXT", 2.0)
    shown.append(answer_and_texts(client, RUN_PREARM_CHECKS))
    shown.append(answer_and_texts(client, 400, 1.0))
    client.set_parameter(name, good, kind)
    client.command(400, 0)
    client.gather("STATUSTEXT", 2.0)
    return "; ".join(shown)


def answer_and_texts(client: Client, number: int, first: float = 0.0) -> str:
    """Send a command; return its result and the texts of the next two seconds, each once."""
    client.send.command_long_send(client.system, 1, number, 0, first, 0, 0, 0, 0, 0, 0)
    messages = client.gather("COMMAND_ACK STATUSTEXT", 2.0)
    results = [
        result_name(message.result)
        for message in messages
        if message.get_type() == "COMMAND_ACK" and message.command == number
    ]
    texts = texts_of([message for message in messages if message.get_type() == "STATUSTEXT"])
    return f"{', '.join(results) or 'no answer'} {' '.join(dict.fromkeys(texts))}".strip()


# -- time, shell -------------------------------------------------------------------------------------------------------


@case("TIMESYNC")
def timesync(client: Client) -> str:
    client.send.timesync_send(0, 123_456_789)
    answer = client.wait("TIMESYNC", lambda message: message.ts1 == 123_456_789)
    return "no answer" if answer is None else "answered"


def typed(client: Client, line: str) -> list[str]:
    """Type a line into PX4's shell; return the printed lines without the echo, digits as 0."""
    data = f"{line}\n".encode()
    client.send.serial_control_send(10, 6, 0, 0, len(data), data.ljust(70, b"\0"))
    printed = b""
    while (piece := client.wait("SERIAL_CONTROL", seconds=1.0)) is not None:
        printed += bytes(piece.data[: piece.count])
        if printed.endswith(b"pxh> "):
            break
    lines = printed.decode(errors="replace").splitlines()
    return [re.sub(r"[0-9]+", "0", text) for text in lines[1:-1]]


def shell_case(line: str, *, labels: bool = False) -> None:
    """Register a case that types a line; with `labels` only what stands before a colon is compared."""

    def play(client: Client) -> str:
        lines = typed(client, line)
        if labels:
            lines = [text.partition(":")[0] for text in lines]
            lines = [text for text in lines if text != "PX0 git-branch"]  # of a build from a branch
        return " / ".join(text.strip() for text in lines if text.strip()) or "no answer"

    CASES[f"PX4's shell: {line}"] = play


shell_case("ver all", labels=True)
shell_case("param show MPC_XY_VEL_MAX")
shell_case("commander status")
shell_case("listener vehicle_status", labels=True)
shell_case("listener no_such_topic")
shell_case("dmesg")
shell_case("no_such_command")


# -- texts of a flight -------------------------------------------------------------------------------------------------


@case("texts of arming after SET_MESSAGE_INTERVAL of STATUSTEXT: never, default, stop, 20 Hz")
def text_interval(client: Client) -> str:
    answers = ["never"]
    shown = [arming_texts(client)]
    for interval_us in (0, -1, TEXT_US):
        answers.append(client.command(511, dialect.MAVLINK_MSG_ID_STATUSTEXT, interval_us))
        shown.append(arming_texts(client))
    return "; ".join(f"{answer}: {texts}" for answer, texts in zip(answers, shown, strict=True))


def arming_texts(client: Client) -> str:
    """Arm and disarm; return how many texts come."""
    client.gather("STATUSTEXT", 5.5)  # PX4 sends texts of the last five seconds afterwards
    client.command(400, 1)
    came = client.gather("STATUSTEXT", 1.5)
    client.command(400, 0)
    came += client.gather("STATUSTEXT", 1.5)
    return "texts" if came else "none"


LOGGER = "[logger]"
"""Beginning of texts about the logs of the simulator's computer."""
HOP_S = 60.0


@case("texts of a PX4: take-off, disarmed in the air, landing")
def texts_of_a_hop(client: Client) -> str:
    if client.autopilot != dialect.MAV_AUTOPILOT_PX4:
        return "not flown"
    nan = float("nan")
    texts: list[str] = []
    client.arm()
    client.gather("HEARTBEAT", 1.0)
    for number, first, seconds in ((22, 0.0, 10.0), (400, 0.0, 2.0), (21, 0.0, 2.0)):
        client.send.command_long_send(client.system, 1, number, 0, first, 0, 0, nan, nan, nan, nan)
        texts += texts_of(client.gather("STATUSTEXT", seconds))
    end_s = time.monotonic() + HOP_S
    while time.monotonic() < end_s and not (texts and "isarm" in texts[-1]):
        texts += texts_of(client.gather("STATUSTEXT", 1.0))
    return "; ".join(texts)


def texts_of(messages: list[Any]) -> list[str]:
    """Return texts with their severities, without those about its logs."""
    return [
        f"{message.severity} {message.text.rstrip()!r}"
        for message in messages
        if not message.text.startswith(LOGGER)
    ]


# -- reboot, the last of all -------------------------------------------------------------------------------------------


@case("a parameter set, then PREFLIGHT_REBOOT_SHUTDOWN, read again", LAST)
def parameter_over_reboot(client: Client) -> str:
    name = "COM_RC_STICK_OV" if client.autopilot == dialect.MAV_AUTOPILOT_PX4 else "WPNAV_SPEED"
    value = 20.0 if name.startswith("COM") else 600.0
    before = client.read_parameter(name)
    client.set_parameter(name, value, dialect.MAV_PARAM_TYPE_REAL32)
    client.gather("HEARTBEAT", 1.0)
    answer = client.command(246, 1)
    client.reconnect()
    after = client.read_parameter(name)
    client.set_parameter(name, before, dialect.MAV_PARAM_TYPE_REAL32)
    return f"{answer}; {'kept' if after == value else f'{after}'}"


def bits_as_float(value: int) -> float:
    """Return the float whose bits are an integer's, as PX4 encodes integer parameters."""
    number: float = struct.unpack("<f", struct.pack("<i", value))[0]
    return number


def type_of(message: Any | None) -> str:
    """Return a message's name."""
    return "no answer" if message is None else str(message.get_type())
