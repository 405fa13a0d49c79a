"""`sitl-mock compare` on recordings made here: equal behaviour has no difference, each kind is found."""

import json
import struct

import pytest
from typer.testing import CliRunner

from sitl_mock import MockVehicle
from sitl_mock.cli import app
from sitl_mock.compare import BOOTED_S, behaviour_of, differences, fly_recording, read_tlog
from sitl_mock.errors import ConfigError
from sitl_mock.mavlink import Decoder, Encoder

RUNNER = CliRunner(env={"COLUMNS": "140"})
STARTED_US = 1_760_000_000_000_000
GUIDED = (176, 1, 4)
ARM = (400, 1)
TAKE_OFF = (22, 0, 0, 0, 0, 0, 0, 5)
RATES = [(511, 32, 20_000), (511, 30, 50_000), (511, 33, 100_000)]


def recorded(
    path,
    flavour="arducopter",
    *,
    commands=(*RATES, GUIDED, ARM, TAKE_OFF),
    seconds=20.0,
    change=None,
):
    """Write a tlog of a mock that a client has flown; `change(name)` may drop (None) or keep a message."""
    vehicle = MockVehicle(flavour, ready_after_s=0.0, links={"recorded": "onboard"})
    vehicle.step(-BOOTED_S)
    vehicle.step(-0.01)
    encoder = Encoder(255, 190)
    decoder = Decoder()
    raw = []

    def write(at_s, frame):
        raw.append(struct.pack(">Q", STARTED_US + round(at_s * 1e6)) + frame)

    for step in range(round(seconds * 100)):
        now_s = step * 0.01
        number = step // 50
        frames = []
        if step % 50 == 0 and number < len(commands):
            number, *params = commands[number]
            frames = [
                encoder.pack("COMMAND_LONG", 1, 1, number, 0, *params, *[0] * (7 - len(params)))
            ]
        for frame in frames:
            write(now_s, frame)
        for frame in vehicle.step(now_s, frames):
            (message,) = decoder.feed(frame, whole=True)
            if change is None or change(message):
                write(now_s, frame)
    path.write_bytes(b"".join(raw))
    return path


@pytest.mark.parametrize("flavour", [pytest.param("px4", marks=pytest.mark.long), "arducopter"])
def test_a_recording_of_the_mock_itself_is_no_different(tmp_path, flavour):
    commands = (ARM,) if flavour == "px4" else (*RATES, GUIDED, ARM, TAKE_OFF)
    file = recorded(tmp_path / "flight.tlog", flavour, commands=commands, seconds=12.0)
    recording = read_tlog(file)
    assert (recording.flavour, recording.system_id) == (flavour, 1)
    mock = behaviour_of(fly_recording(recording))
    assert differences(behaviour_of(recording.said), mock) == []
    result = RUNNER.invoke(app, ["compare", str(file)])
    assert (result.exit_code, "No difference." in result.output) == (0, True)


def test_a_message_that_one_side_lacks_is_found(tmp_path):
    file = recorded(
        tmp_path / "flight.tlog", change=lambda message: message.get_type() != "ATTITUDE"
    )
    recording = read_tlog(file)
    found = differences(behaviour_of(recording.said), behaviour_of(fly_recording(recording)))
    assert [(each.kind, each.message) for each in found] == [("extra", "ATTITUDE")]
    swapped = differences(behaviour_of(fly_recording(recording)), behaviour_of(recording.said))
    assert [(each.kind, each.message) for each in swapped] == [("missing", "ATTITUDE")]


def test_a_rate_that_is_half_is_found_and_named(tmp_path):
    kept = iter(range(10**6))
    file = recorded(
        tmp_path / "flight.tlog",
        change=lambda message: message.get_type() != "LOCAL_POSITION_NED" or next(kept) % 2 == 0,
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
    frozen = sorted(still + [(0.05 * n, attitude) for n in range(400)], key=lambda item: item[0])
    found = differences(behaviour_of(frozen), behaviour_of(fly_recording(recording)))
    assert ("constant", "ATTITUDE", "pitch (air)") in {each[:3] for each in found}
    assert {each.message for each in found} == {"ATTITUDE"}


def test_ranges_are_shown_on_request(tmp_path):
    file = recorded(tmp_path / "flight.tlog", seconds=6.0)
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


def test_a_recording_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path):
    file = recorded(tmp_path / "flight.tlog", seconds=5.0)
    whole = read_tlog(file)
    file.write_bytes(file.read_bytes()[:-7])
    assert len(read_tlog(file).said) == len(whole.said) - 1
