"""Hostile or damaged records: memory is bounded, and every command ends with one clear line."""

import json
import random
import resource
import struct
import subprocess
import sys
import time
from functools import cache
from itertools import islice
from pathlib import Path

import pytest
import zstandard
from mcap.writer import CompressionType, Writer
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.errors import ConfigError, GuidanceError
from guidance.log import Survey, record_errors, scan
from guidance.log.entries import CYCLE, EVENT, REPORT, Item
from guidance.log.writer import Recorder
from tests.harness.examples import drawn

SHORT = Path(__file__).parents[1] / "data" / "short_chase.mcap"
MAGIC = b"\x89MCAP0\r\n"
HOSTILE = [
    None,
    True,
    -1,
    10**400,
    1e308,
    -1e308,
    "",
    "x",
    "NaN",
    [],
    {},
    [[]],
    {"kind": 7},
    {"kind": "Home"},
]
COMMANDS = {
    "info": ["log", "info", "{file}"],
    "events": ["log", "events", "{file}"],
    "csv": ["log", "export", "{file}", "{folder}/a.csv"],
    "geojson": ["log", "export", "{file}", "{folder}/a.geojson"],
    "tlog": ["log", "export", "{file}", "{folder}/a.tlog"],
    "replay": ["replay", "{file}"],
    "what if": ["replay", "{file}", "--with", "policy=pure_pursuit"],
}


def prefixed(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def bomb(claimed: int, true: int) -> bytes:
    """Return a file with one chunk that claims `claimed` bytes and unpacks to `true` zeros."""
    packed = zstandard.ZstdCompressor(level=19).compress(bytes(true))
    chunk = (
        struct.pack("<QQQI", 0, 0, claimed, 0)
        + prefixed(b"zstd")
        + struct.pack("<Q", len(packed))
        + packed
    )
    return MAGIC + record(1, prefixed(b"") + prefixed(b"")) + record(6, chunk)


@pytest.mark.parametrize(
    ("claimed", "true"), [(2**32, 2**27), (2**20, 2**27), (2**62, 100), (10, 2**20)]
)
def test_a_chunk_that_misstates_its_size_takes_no_memory(tmp_path, claimed, true):
    """Catches memory that is taken for a size that a stranger wrote."""
    path = tmp_path / "bomb.mcap"
    path.write_bytes(bomb(claimed, true))
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    survey = Survey()
    assert list(scan(path, survey)) == []
    assert f"states {claimed}" in survey.damage
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < 2**27 / 1024


def many_chunks(path: Path, chunk: bytes, count: int) -> Path:
    """Write a file of equal chunks that state their true size."""
    packed = zstandard.ZstdCompressor(level=19).compress(chunk)
    head = (
        struct.pack("<QQQI", 0, 0, len(chunk), 0)
        + prefixed(b"zstd")
        + struct.pack("<Q", len(packed))
    )
    seed = prefixed(b"seed") + prefixed(b"1")
    run = record(12, prefixed(b"run") + prefixed(seed))
    path.write_bytes(
        MAGIC + record(1, prefixed(b"") + prefixed(b"")) + run + count * record(6, head + packed)
    )
    return path


def attack(folder: Path, kind: str) -> Path:
    """Write a small file with 4 GB of zeros, one message per chunk, or with 1.6 million empty messages."""
    channel = record(4, struct.pack("<HH", 1, 0) + prefixed(b"a") + prefixed(b"json") + bytes(4))
    if kind == "large":
        chunk = channel + record(5, struct.pack("<HIQQ", 1, 0, 0, 0) + bytes(16_000_000))
        return many_chunks(folder / "large.mcap", chunk, 260)
    return many_chunks(
        folder / "many.mcap", channel + 30_000 * record(5, struct.pack("<HIQQ", 1, 0, 0, 0)), 53
    )


@pytest.mark.parametrize(
    ("kind", "command"),
    [("large", "info"), ("many", "events"), ("large", "tlog"), ("many", "scenario")],
)
def test_a_small_file_that_expands_to_gigabytes_is_refused_at_once(tmp_path, kind, command):
    path = attack(tmp_path, kind)
    assert path.stat().st_size < 200_000
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(f'[evader]\npolicy = "recorded"\ntrack = "{path.name}"\n')
    commands = {**COMMANDS, "scenario": ["scenario", "show", str(scenario)]}
    given = [word.format(file=path, folder=tmp_path) for word in commands[command]]
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began_s = time.process_time()
    result = CliRunner().invoke(app, given)
    assert time.process_time() - began_s < 10.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < 100 * 1024
    assert isinstance(result.exception, ConfigError)
    assert "no flight wrote it" in str(result.exception)


@pytest.mark.parametrize("length", [21, 23, 2**63])
def test_a_message_that_misstates_its_length_is_damage(tmp_path, length):
    path = tmp_path / "lying.mcap"
    channel = record(
        4, struct.pack("<HH", 1, 0) + prefixed(b"a") + prefixed(b"json") + struct.pack("<I", 0)
    )
    message = struct.pack("<HIQQ", 1, 0, 10**9, 10**9)
    for claimed, heard in ((len(message), [1.0]), (length, [])):
        content = (
            channel
            + record(5, message)
            + record(99, b"another's")
            + struct.pack("<BQ", 5, claimed)
            + message
        )
        chunk = (
            struct.pack("<QQQI", 0, 0, len(content), 0)
            + prefixed(b"")
            + struct.pack("<Q", len(content))
            + content
        )
        path.write_bytes(MAGIC + record(1, prefixed(b"") + prefixed(b"")) + record(6, chunk))
        survey = Survey()
        assert [item.now_s for item in scan(path, survey)] == 2 * heard
        assert survey.torn is not None


def test_an_impossible_length_is_not_read(tmp_path):
    path = tmp_path / "long.mcap"
    text = struct.pack("<I", 2**32 - 1) + b"abc"
    path.write_bytes(MAGIC + record(12, text))
    survey = Survey()
    assert list(scan(path, survey)) == []
    assert survey.damaged_chunks == 1
    assert survey.metadata == {}


def test_the_original_error_is_kept_as_the_cause():
    said = r"a\.mcap: cannot be read as a record \(KeyError: 'x'\)"
    with pytest.raises(ConfigError, match=said) as raised, record_errors(Path("a.mcap")):
        {}["x"]
    assert isinstance(raised.value.__cause__, KeyError)


def test_text_from_a_record_cannot_command_the_terminal(tmp_path):
    path = tmp_path / "record.mcap"
    hostile = "\x1b]0;owned\x07\x1b[2J\r\u202e"
    recorder = Recorder(path, {"scenario": json.dumps({"title": hostile}), hostile: hostile})
    recorder.event(1.0, hostile, hostile)
    recorder.frames([(1.0, hostile, b"")])
    recorder.close()
    for command in ("info", "events"):
        shown = CliRunner().invoke(app, ["log", command, str(path)])
        assert shown.exit_code == 0
        assert all(one.isprintable() or one == "\n" for one in shown.output)
        assert "\\x1b]0;owned\\x07\\x1b[2J\\r\\u202e" in shown.output


def nodes(value, path=()):
    """Yield the path of every value in a JSON document."""
    yield path
    items = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    for key, inside in items:
        yield from nodes(inside, (*path, key))


def spoilt(document, draw):
    """Return the document with one value replaced by a wrong one, or removed."""
    *way, last = draw.choice([path for path in nodes(document) if path])
    holder = document
    for key in way:
        holder = holder[key]
    if isinstance(holder, dict) and draw.random() < 0.3:
        del holder[last]
    else:
        holder[last] = draw.choice(HOSTILE)
    return document


@cache
def beginning() -> tuple[list[Item], dict[str, str]]:
    """Return the first messages of the short chase, and its metadata."""
    survey = Survey()
    items = list(islice(scan(SHORT, survey), 900))
    return items, survey.metadata


def mutated(out: Path, seed: int) -> None:
    """Copy the short chase with correct checksums and one wrong value in metadata, a cycle, an event or a report."""
    draw = random.Random(seed)
    items, told = beginning()
    topics = [CYCLE.topic] * 6 + [EVENT.topic, REPORT.topic, None, None]
    topic = topics[seed % len(topics)]
    of_topic = [number for number, item in enumerate(items) if item.topic == topic]
    chosen = draw.choice(of_topic) if of_topic else None
    metadata = dict(told)
    if topic is None:
        scenario = spoilt(json.loads(metadata["scenario"]), draw)
        metadata["scenario"] = (
            json.dumps(scenario) if draw.random() < 0.8 else draw.choice(["", "[", "[]", "7"])
        )
    with out.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        channels = {}
        writer.start()
        writer.add_metadata("run", metadata)
        for number, item in enumerate(items):
            data = item.data
            if number == chosen:
                nested = draw.random() < 0.05
                data = (
                    b"[" * 50_000 if nested else json.dumps(spoilt(json.loads(data), draw)).encode()
                )
            if item.topic not in channels:
                channels[item.topic] = writer.register_channel(item.topic, item.encoding, 0)
            time_ns = round(item.now_s * 1e9)
            writer.add_message(channels[item.topic], time_ns, data, time_ns, number)
        writer.finish()


@pytest.mark.parametrize("seed", range(drawn(120)))
def test_no_command_ends_with_a_traceback_for_a_mutated_record(tmp_path, seed):
    path = tmp_path / "mutated.mcap"
    mutated(path, seed)
    names = list(COMMANDS)
    for name in (names[seed % len(names)], names[(seed + 3) % len(names)]):
        given = [word.format(file=path, folder=tmp_path) for word in COMMANDS[name]]
        result = CliRunner().invoke(app, given)
        assert result.exception is None or isinstance(
            result.exception, GuidanceError | SystemExit
        ), (name, result)


@pytest.mark.parametrize("seed", range(4))
def test_no_report_ends_with_a_traceback_for_a_mutated_record(tmp_path, seed):
    """Catches a picture that trusts a value of a record."""
    path = tmp_path / "mutated.mcap"
    mutated(path, seed)
    result = CliRunner().invoke(app, ["report", str(path)])
    assert result.exception is None or isinstance(result.exception, GuidanceError | SystemExit), (
        result
    )


def test_a_hostile_record_gives_one_line_of_error(tmp_path):
    """Catches a traceback of the program itself, behind all commands."""
    path = tmp_path / "bomb.mcap"
    path.write_bytes(bomb(2**32, 1000))
    program = [sys.executable, "-c", "from guidance.cli import main; main()", "replay", str(path)]
    done = subprocess.run(program, capture_output=True, text=True, timeout=60.0, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        f"error: {path}: ends before its first message: nothing can be read"
    ]
