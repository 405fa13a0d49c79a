"""PX4's shell, as `mavlink_shell.py` sees it: versions, parameters, the commander's state and topics.

Source: ``pxh.cpp`` and the commands of PX4 1.17, whose texts it has. Commands that are not in `SHELL_COMMANDS` are
unknown here.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

from sitl_mock.logs.ulog import fields_of
from sitl_mock.protocols import ParameterError, ParamKind
from sitl_mock.px4.modes import NAV_STATES
from sitl_mock.px4.topics import SOURCES, state_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from sitl_mock.logs.ulog import TopicField
    from sitl_mock.telemetry import Report

_SYMBOLS: Final = "Symbols: x = used, + = saved, * = unsaved\n"
_ALIGNED: Final = 8
"""A topic's size is a multiple of this; a line without text shows its padding."""
_CYCLES_HZ: Final = 77
_CHECKS_HZ: Final = 8.6
_UNKNOWN_TOPIC: Final = "Topic {} did not match any known topics\n"
_MOST_MESSAGES: Final = 100


class Answer(NamedTuple):
    """What a command prints, and what it returns: 0 for success."""

    text: str
    code: int = 0


def answer_to(report: Report, line: str) -> str:
    """Return the answer to a line."""
    words = line.split()
    if not words or words[0].startswith("#"):
        return ""
    name, *arguments = words
    if name == "help":
        return "Builtin Commands:\n" + "".join(f"  {command}\n" for command in SHELL_COMMANDS)
    command = SHELL_COMMANDS.get(name)
    if command is None:
        return f"Invalid command: {name}\ntype 'help' for a list of commands\n"
    answer = command(report, arguments)
    failed = f"Command '{name}' failed, returned {answer.code}.\n" if answer.code else ""
    return answer.text + failed


# -- ver ---------------------------------------------------------------------------------------------------------------


def ver(report: Report, arguments: Sequence[str]) -> Answer:
    """Versions: ``ver all``, or one part of it."""
    if not arguments:
        return Answer("Error, not enough parameters.\nUsage: ver <command> [arguments...]\n", 1)
    identity = report.flavour.identity(report.state.system_id)
    version = _release(identity.version)
    parts = {
        "hw": "HW arch: PX4_SITL\n",
        "git": (
            f"PX4 git-hash: {identity.commit[::-1].hex()}\nPX4 version: {version}\n"
            f"PX4 git-branch: main\nOS: Linux\nOS version: {_release(identity.os_version)}\n"
        ),
        "bdate": "Build datetime: Jan  1 2026 00:00:00\n",
        "uri": "Build uri: localhost\nBuild variant: default\n",
        "gcc": "Toolchain: GNU GCC, 13.3.0\n",
        "px4guid": "PX4GUID: 1006554d49534954414c44494e4f30303030\n",
        "mcu": "UNKNOWN MCU\n",
    }
    chosen = arguments[0]
    if chosen == "all":
        return Answer("".join(parts.values()))
    if chosen not in parts:
        return Answer("ERROR [ver] unknown command\n", 1)
    text = parts[chosen]
    if chosen == "git":
        text = "".join(part for part in text.splitlines(True) if "git-branch" not in part)
    return Answer(text)


def _release(version: tuple[int, int, int]) -> str:
    major, minor, patch = version
    return f"Release {major}.{minor}.{patch} ({major << 24 | minor << 16 | patch << 8 | 255})"


# -- param -------------------------------------------------------------------------------------------------------------


def param(report: Report, arguments: Sequence[str]) -> Answer:
    """Parameters: ``show``, ``set`` and ``save``."""
    verb = arguments[0] if arguments else ""
    words = arguments[1:]
    if verb == "show":
        return _show(report, words)
    if verb == "set":
        return _set(report, words)
    if verb == "save":
        return Answer("")
    return Answer("\nUsage: param <command> [arguments...]\n", 1)


def _show(report: Report, words: Sequence[str]) -> Answer:
    parameters = report.state.parameters
    names: Iterable[str] = parameters.names
    option = words[0] if words else ""
    if option == "-q":
        name = words[-1].upper()
        if name not in parameters.definitions:
            return Answer("", 1)
        return Answer(f"{_shown(report, name)}\n")
    pattern = words[-1].upper() if words and not words[-1].startswith("-") else "*"
    if option == "-c":
        names = [name for name in names if _is_changed(report, name)]
    lines = [_SYMBOLS]
    for name in names:
        if name != pattern and not (pattern.endswith("*") and name.startswith(pattern[:-1])):
            continue
        index = parameters.index[name]
        mark = "+" if _is_changed(report, name) else " "
        lines.append(f"x {mark} {name} [{index},{index}] : {_shown(report, name)}\n")
    count = len(parameters.names)
    total = len(parameters.definitions)
    if option == "-a":
        lines.append(f"\n {total} parameters total, {count} used.\n")
    else:
        lines.append(f"\n {count}/{total} parameters used.\n")
    return Answer("".join(lines))


def _shown(report: Report, name: str) -> str:
    parameters = report.state.parameters
    if parameters.definitions[name].kind is ParamKind.REAL32:
        return f"{parameters[name]:.4f}"
    return f"{int(parameters[name])}"


def _is_changed(report: Report, name: str) -> bool:
    parameters = report.state.parameters
    return parameters[name] != parameters.default_of(name)


def _set(report: Report, words: Sequence[str]) -> Answer:
    parameters = report.state.parameters
    if len(words) < 2:
        name = words[0] if words else "PARAM_NAME"
        hint = f"ERROR [param] not enough arguments.\nTry 'param set {name} 3 [fail]'\n"
        return Answer(hint, 1)
    name = words[0]
    if name not in parameters.definitions:
        return Answer(f"ERROR [param] Parameter {name} not found.\n", int("fail" in words[2:]))
    before = _shown(report, name)
    mark = "+" if _is_changed(report, name) else " "
    was = parameters[name]
    try:
        parameters.set(name, float(words[1]))
    except (ParameterError, ValueError):
        parameters.set(name, 0.0)  # strtod of a text that is no number
    if parameters[name] == was:
        return Answer("")
    report.state.parameter_news.append(name)
    return Answer(f"{mark} {name}: curr: {before} -> new: {_shown(report, name)}\n")


# -- commander ---------------------------------------------------------------------------------------------------------


def commander(report: Report, arguments: Sequence[str]) -> Answer:
    """The commander's state: ``status`` and ``check``."""
    if list(arguments) == ["status"]:
        now_s = report.boot_us * 1e-6
        intended = state_of(report.commander.intended_mode)
        names = dict(NAV_STATES.values())
        lines_of_result = (
            "Armed" if report.state.armed else "Disarmed",
            f"navigation mode: {NAV_STATES[report.commander.mode][1]}",
            f"user intended navigation mode: {names[intended]}",
            f"in failsafe: {'yes' if report.commander.system_status == 5 else 'no'}",
        )
        counted = (("cycle", _CYCLES_HZ), ("preflight check", _CHECKS_HZ))
        lines = [f"INFO  [commander] {line}\n" for line in lines_of_result]
        for name, rate_hz in counted:
            events = int(now_s * rate_hz)
            lines.append(
                f"commander: {name}: {events} events, 0us elapsed, 0.00us avg, min 0us max 0us 0.000us rms\n"
            )
        return Answer("".join(lines))
    if list(arguments) == ["check"]:
        passed = report.state.armed or report.commander.ready_to_arm
        return Answer(f"INFO  [commander] Preflight check: {'OK' if passed else 'FAILED'}\n")
    return Answer("\nUsage: commander <command> [arguments...]\n", 1)


# -- listener ----------------------------------------------------------------------------------------------------------


def listener(report: Report, arguments: Sequence[str]) -> Answer:
    """A topic's present message: ``listener TOPIC``, ``-n`` for several times, ``-i`` for an instance."""
    if not arguments:
        return Answer("\nUsage: listener <command> [arguments...]\n", 1)
    name = arguments[0]
    if name not in SOURCES:
        return Answer(_UNKNOWN_TOPIC.format(name), -1)
    options = dict(zip(arguments[1::2], arguments[2::2], strict=False))
    if _number(options.get("-i", "0")) != 0:
        return Answer("never published\n")
    count = min(max(_number(options.get("-n", "1")), 1), _MOST_MESSAGES)
    source = SOURCES[name]
    values = iter(source.build(report))
    body = f" {name}\n"
    for field in fields_of(source.topic.text):
        part = [next(values) for _ in range(field.length)]
        shown = ", ".join(_scalar(field.kind, value) for value in part)
        if field.length > 1:
            shown = f"[{shown}]"
        body += f"    {field.name}: {shown}{_remark(field, part, report.boot_us)}\n"
    if source.topic.size % _ALIGNED:
        body += "\n"
    if count == 1 and "-i" not in options:
        return Answer(f"\nTOPIC: {name}\n{body}")
    clear = "\x1b[2J\n\x1b[H" if count > 1 else ""
    return Answer(
        "".join(
            f"{clear}\nTOPIC: {name} instance 0 #{number}\n{body}" for number in range(1, count + 1)
        )
    )


def _number(text: str) -> int:
    return int(text) if text.isdecimal() else 0


def _scalar(kind: str, value: float) -> str:
    if kind == "float":
        return f"{value:.5f}"
    if kind == "double":
        return f"{value:.6f}"
    if kind == "bool":
        return "True" if value else "False"
    return f"{int(value)}"


def _remark(field: TopicField, part: Sequence[float], now_us: int) -> str:
    if field.name == "timestamp":
        return f" ({(now_us - part[0]) * 1e-6:.6f} seconds ago)" if part[0] else ""
    if field.name == "timestamp_sample":
        return " (0 us before timestamp)" if part[0] else ""
    if field.name == "q":
        w, x, y, z = part
        roll = math.degrees(math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
        pitch = math.degrees(math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0)))
        yaw = math.degrees(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
        return f" (Roll: {roll:.1f} deg, Pitch: {pitch:.1f} deg, Yaw: {yaw:.1f} deg)"
    return ""


SHELL_COMMANDS: Final[Mapping[str, Callable[[Report, Sequence[str]], Answer]]] = {
    "commander": commander,
    "listener": listener,
    "param": param,
    "ver": ver,
}
"""The commands of the shell, besides ``help``."""
