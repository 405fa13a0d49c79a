"""`sitl-mock compare` on recordings made here: equal behaviour has no difference, each kind is found."""

import itertools
import json
import struct
from functools import cache

import pytest
from typer.testing import CliRunner

from sitl_mock import MockVehicle
from sitl_mock.cli import app
from sitl_mock.compare import BOOTED_S, behaviour_of, differences, fly_recording, read_tlog
from sitl_mock.errors import ConfigError
from sitl_mock.mavlink import Decoder, Encoder
from sitl_mock.world import DEFAULT_HOME, Home

RUNNER = CliRunner(env={"COLUMNS": "140"})
STARTED_US = 1_760_000_000_000_000
GUIDED = (176, 1, 4)
ARM = (400, 1)
TAKE_OFF = (22, 0, 0, 0, 0, 0, 0, 5)
RATES = ((511, 32, 20_000), (511, 30, 50_000), (511, 33, 100_000))


@cache
def flown(flavour, commands, seconds, home):
    """Fly a mock as a client; return each frame with its time, and the message if it is the vehicle's."""
    vehicle = MockVehicle(flavour, ready_after_s=0.0, home=home, links={"recorded": "onboard"})
    vehicle.step(-BOOTED_S)
    vehicle.step(-0.01)
    encoder = Encoder(255, 190)
    decoder = Decoder()
    frames = []
    for step in range(round(seconds * 100)):
        now_s = step * 0.01
        number = step // 50
        sent = []
        if step % 50 == 0 and number < len(commands):
            number, *params = commands[number]
            sent = [
                encoder.pack("COMMAND_LONG", 1, 1, number, 0, *params, *[0] * (7 - len(params)))
            ]
        frames += [(now_s, frame, None) for frame in sent]
        for frame in vehicle.step(now_s, sent):
            (message,) = decoder.feed(frame, whole=True)
            frames.append((now_s, frame, message))
    return frames


def recorded(
    path,
    flavour="arducopter",
    *,
    commands=(*RATES, GUIDED, ARM, TAKE_OFF),
    seconds=12.0,
    keep=lambda _message: True,
    home=DEFAULT_HOME,
):
    """Write a tlog of a mock that a client has flown, with the messages of the vehicle that `keep` keeps."""
    path.write_bytes(
        b"".join(
            struct.pack(">Q", STARTED_US + round(at_s * 1e6)) + frame
            for at_s, frame, message in flown(flavour, commands, seconds, home)
            if message is None or keep(message)
        )
    )
    return path


@pytest.mark.parametrize("flavour", [pytest.param("px4", marks=pytest.mark.long), "arducopter"])
def test_a_recording_of_the_mock_itself_is_no_different(tmp_path, flavour):
    """Catches a difference that the comparison makes up."""
    commands = (ARM,) if flavour == "px4" else (*RATES, GUIDED, ARM, TAKE_OFF)
    file = recorded(tmp_path / "flight.tlog", flavour, commands=commands)
    recording = read_tlog(file)
    assert (recording.flavour, recording.system_id) == (flavour, 1)
    mock = behaviour_of(fly_recording(recording))
    assert differences(behaviour_of(recording.said), mock) == []
    result = RUNNER.invoke(app, ["compare", str(file)])
    assert (result.exit_code, "No difference." in result.output) == (0, True)


def test_a_message_that_one_side_lacks_is_found(tmp_path):
    """Catches a message that a comparison misses."""
    file = recorded(tmp_path / "flight.tlog", keep=lambda message: message.get_type() != "ATTITUDE")
    recording = read_tlog(file)
    found = differences(behaviour_of(recording.said), behaviour_of(fly_recording(recording)))
    assert [(each.kind, each.message) for each in found] == [("extra", "ATTITUDE")]
    swapped = differences(behaviour_of(fly_recording(recording)), behaviour_of(recording.said))
    assert [(each.kind, each.message) for each in swapped] == [("missing", "ATTITUDE")]


def test_a_rate_that_is_half_is_found_and_named(tmp_path):
    kept = iter(range(10**6))
    file = recorded(
        tmp_path / "flight.tlog",
        keep=lambda message: message.get_type() != "LOCAL_POSITION_NED" or next(kept) % 2 == 0,
    )
    result = RUNNER.invoke(app, ["compare", str(file), "--json"])
    assert result.exit_code == 1
    told = json.loads(result.output)
    assert told["messages"]["LOCAL_POSITION_NED"]["recorded"]["rate_hz"] == pytest.approx(
        25.0, abs=0.2
    )
    assert told["messages"]["LOCAL_POSITION_NED"]["mock"]["rate_hz"] == pytest.approx(50.0, abs=0.2)
    assert {(each["kind"], each["message"]) for each in told["differences"]} == {
        ("rate", "LOCAL_POSITION_NED")
    }


def test_a_field_that_stands_still_on_one_side_is_found_in_its_phase(tmp_path):
    recording = read_tlog(recorded(tmp_path / "flight.tlog"))
    still = [(t, m) for t, m in recording.said if m.get_type() != "ATTITUDE"]
    attitude = next(m for _, m in recording.said if m.get_type() == "ATTITUDE")
    frozen = sorted(still + [(0.05 * n, attitude) for n in range(240)], key=lambda item: item[0])
    found = differences(behaviour_of(frozen), behaviour_of(fly_recording(recording)))
    assert ("constant", "ATTITUDE", "pitch (air)") in {each[:3] for each in found}
    assert {each.message for each in found} == {"ATTITUDE"}


def test_ranges_are_shown_on_request(tmp_path):
    file = recorded(tmp_path / "flight.tlog", seconds=3.0)
    assert "…" in RUNNER.invoke(app, ["compare", str(file), "--ranges"]).output


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "no HEARTBEAT"),
        (bytes(40), "no MAVLink frame"),
        (b"t_s,cmd_n_m_s\n" * 9, "no MAVLink frame"),
    ],
)
def test_what_is_no_recording_is_refused_with_its_name(tmp_path, content, said):
    file = tmp_path / "other.tlog"
    file.write_bytes(content)
    with pytest.raises(ConfigError, match=said) as refused:
        read_tlog(file)
    assert str(file) in str(refused.value)
    with pytest.raises(ConfigError, match="missing"):
        read_tlog(tmp_path / "missing.tlog")


def record_starts(raw):
    """Offset of every record: a time and its frame."""
    starts = []
    at = 0
    while at < len(raw):
        starts.append(at)
        at += 8 + 12 + raw[at + 9]
    return starts


def changed(file, name, edit):
    """Write a copy of a recording, with its bytes and the offset of a record in its middle edited."""
    raw = bytearray(file.read_bytes())
    starts = record_starts(raw)
    other = file.with_name(name)
    other.write_bytes(edit(raw, starts[len(starts) // 2]))
    return other


@pytest.mark.parametrize(
    ("edit", "lost"),
    [
        (lambda raw, at: raw[:at] + b"\x00\x11\x22" + raw[at:], 0),
        (lambda raw, at: raw[: at + 14] + raw[at + 19 :], 1),
        (lambda raw, at: raw[: at + 20] + bytes([raw[at + 20] ^ 0xFF]) + raw[at + 21 :], 1),
        (lambda raw, at: raw[: at + 9] + b"\xff" + raw[at + 10 :], 1),
        (lambda raw, at: raw + bytes(64), 0),
        (lambda raw, at: raw[5:], 1),
    ],
    ids=["inserted", "deleted", "flipped", "wrong length", "zeros at the end", "no head"],
)
def test_junk_bytes_cost_no_more_than_their_frame(tmp_path, edit, lost):
    whole = recorded(tmp_path / "flight.tlog", seconds=3.0)
    recording = read_tlog(changed(whole, "junk.tlog", edit))
    frames = len(read_tlog(whole).said) + len(read_tlog(whole).heard)
    assert len(recording.said) + len(recording.heard) == frames - lost
    assert recording.end_s == pytest.approx(read_tlog(whole).end_s, abs=0.1)


def test_skipped_bytes_are_counted(tmp_path):
    whole = recorded(tmp_path / "flight.tlog", seconds=3.0)
    junk = changed(whole, "junk.tlog", lambda raw, at: raw[:at] + bytes(7) + raw[at:])
    assert read_tlog(whole).notes == ()
    size = junk.stat().st_size
    assert read_tlog(junk).notes == (f"7 of {size} bytes are no MAVLink frames and are skipped",)
    assert "Note: 7 of" in RUNNER.invoke(app, ["compare", str(junk)]).output


@pytest.mark.parametrize("step_us", [1 << 50, 3600 * 10**6, -86_400 * 10**6])
@pytest.mark.parametrize("records", [1, 10**6], ids=["one time", "from there on"])
def test_a_step_of_the_clock_does_not_stretch_the_flight(tmp_path, step_us, records):
    whole = recorded(tmp_path / "flight.tlog", seconds=3.0)

    def stepped(raw, at):
        for start in [start for start in record_starts(raw) if start >= at][:records]:
            (time_us,) = struct.unpack_from(">Q", raw, start)
            struct.pack_into(">Q", raw, start, time_us + step_us)
        return raw

    recording = read_tlog(changed(whole, "step.tlog", stepped))
    assert recording.end_s == pytest.approx(read_tlog(whole).end_s, abs=0.1)
    assert "clock" in recording.notes[0]
    times_s = [time_s for time_s, _ in recording.said]
    assert times_s == sorted(times_s)


def test_a_long_silence_that_the_vehicles_clock_confirms_is_kept(tmp_path):
    encoder = Encoder(1, 1)
    raw = b""
    for now_s in (0.0, 1.0, 301.0, 302.0):
        stamp = struct.pack(">Q", STARTED_US + round(now_s * 1e6))
        raw += stamp + encoder.pack("HEARTBEAT", 2, 3, 81, 0, 3, 3)
        raw += stamp + encoder.pack("ATTITUDE", 5000 + round(now_s * 1e3), *[0.0] * 6)
    file = tmp_path / "silence.tlog"
    file.write_bytes(raw)
    recording = read_tlog(file)
    assert recording.end_s == pytest.approx(302.0)
    assert not [note for note in recording.notes if "clock" in note]


@pytest.mark.parametrize(
    ("autopilot", "kind", "flavour"),
    [
        (3, 2, "arducopter"),
        (3, 13, "arducopter"),
        (3, 4, "arducopter"),
        (3, 10, "rover"),
        (12, 14, "px4"),
        (3, 1, None),
        (3, 12, None),
        (3, 7, None),
        (12, 1, None),
        (12, 10, None),
        (12, 22, None),
    ],
)
def test_only_vehicles_of_the_mock_are_flown(tmp_path, autopilot, kind, flavour):
    frame = Encoder(1, 1).pack("HEARTBEAT", kind, autopilot, 81, 0, 3, 3)
    file = tmp_path / "beat.tlog"
    file.write_bytes(struct.pack(">Q", STARTED_US) + frame)
    if flavour is None:
        with pytest.raises(ConfigError, match=rf"MAV_TYPE {kind} \("):
            read_tlog(file)
    else:
        assert read_tlog(file).flavour == flavour


def test_a_flight_without_home_position_is_flown_where_it_was(tmp_path):
    home = Home(-35.363262, 149.165237, 584.0)
    kept = {"HOME_POSITION": False, "GPS_GLOBAL_ORIGIN": False}
    whole = recorded(
        tmp_path / "canberra.tlog",
        seconds=8.0,
        home=home,
        keep=lambda message: kept.get(message.get_type(), True),
    )
    recording = read_tlog(whole)
    assert recording.notes == ()
    positions = [m for _, m in fly_recording(recording) if m.get_type() == "GLOBAL_POSITION_INT"]
    assert positions[0].lat * 1e-7 == pytest.approx(home.lat_deg, abs=1e-4)
    assert positions[0].lon * 1e-7 == pytest.approx(home.lon_deg, abs=1e-4)
    assert positions[0].alt * 1e-3 == pytest.approx(home.alt_amsl_m, abs=1.0)


def test_a_log_of_one_side_is_said_to_be_one(tmp_path):
    whole = recorded(tmp_path / "flight.tlog", seconds=3.0)
    vehicle_only = tmp_path / "vehicle.tlog"
    raw = whole.read_bytes()
    starts = [*record_starts(raw), len(raw)]
    vehicle_only.write_bytes(
        b"".join(raw[a:b] for a, b in itertools.pairwise(starts) if raw[a + 8 + 5] == 1)
    )
    assert not read_tlog(whole).one_sided
    assert read_tlog(vehicle_only).one_sided
    told = json.loads(RUNNER.invoke(app, ["compare", str(vehicle_only), "--json"]).output)
    assert told["one_sided"] is True
    assert "one-sided" in told["notes"][0]


def test_a_recording_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path):
    file = recorded(tmp_path / "flight.tlog", seconds=3.0)
    whole = read_tlog(file)
    file.write_bytes(file.read_bytes()[:-7])
    assert len(read_tlog(file).said) == len(whole.said) - 1
