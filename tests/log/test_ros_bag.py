"""The ROS 2 bag of a flight, read by rosbags and by Foxglove's own decoder, holds what the record holds."""

import runpy
from collections import Counter
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.cycle import Alarm, Violation
from guidance.errors import ConfigError, OutputError
from guidance.log import cycles_of, metadata_of
from guidance.log.bag import write_bag
from guidance.log.ros import DIAGNOSTICS, TOPICS, RosFlight, ros_name, topic_name
from guidance.session.flight_files import recorded_settings
from tests.harness.ros_witness import NAME, Witness


@pytest.fixture(scope="module")
def bag(short_flight, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bag") / "flight"
    write_bag({"": short_flight[1]}, folder, recorded_settings)
    return folder


def test_rosbags_reads_every_topic_and_each_message_is_the_records(short_flight, bag):
    """Catches a bag that says something else than the record."""
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        messages = []
        times = []
        for connection, time_ns, data in reader.messages():
            messages.append((connection.topic, reader.deserialize(data, connection.msgtype)))
            times.append(time_ns)
    assert times == sorted(times)
    witness = Witness(short_flight[1])
    compared = witness.compare(messages)
    assert set(compared) == {topic_name(NAME, topic) for topic in TOPICS} | {"isochron"}
    cycles = list(witness.cycles.values())
    assert compared[f"/{NAME}/setpoint"] > 0.4 * sum(entry.setpoint is not None for entry in cycles)
    assert compared["/diagnostics"] >= len({entry.state for entry in cycles})


def test_foxgloves_decoder_reads_the_bag_by_its_own_schemas(short_flight, bag):
    """Catches a bag whose schemas differ from its bytes."""
    with (bag / "flight.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        messages = [
            (channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()
        ]
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    assert set(Witness(short_flight[1]).compare(messages)) == {
        *(topic_name(NAME, topic) for topic in TOPICS),
        "isochron",
    }


def test_a_teams_flight_is_one_bag_with_each_vehicles_topics(short_flight, tmp_path):
    """Catches topics of two vehicles that share a name or a frame."""
    team = tmp_path / "team"
    for name in ("uav-1", "uav-2"):
        (team / name).mkdir(parents=True)
        (team / name / "record.mcap").symlink_to(short_flight[1])
    done = CliRunner().invoke(app, ["log", "export", str(team)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    with AnyReader([team / "ros2"], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        counts = Counter({one.topic: one.msgcount for one in reader.connections})
        frames = set()
        for connection, _, data in reader.messages():
            if connection.topic == "/tf":
                message: Any = reader.deserialize(data, connection.msgtype)
                frames |= {frame.child_frame_id for frame in message.transforms}
    assert counts["/uav_1/odometry"] == counts["/uav_2/odometry"] > 100
    assert counts["/tf"] >= 2 * counts["/uav_1/odometry"] - 2
    assert frames >= {"map", "uav_1/base_link", "uav_2/base_link", "uav_1/evader"}
    assert [path.name for path in team.iterdir() if path.name.startswith(".")] == []


def test_names_become_names_of_ros_and_two_that_become_one_are_refused(short_flight, tmp_path):
    assert ros_name("UAV-1") == "uav_1"
    assert ros_name("7__x_") == "v7_x"
    record = short_flight[1]
    with pytest.raises(ConfigError, match="one in ROS"):
        write_bag({"uav-1": record, "uav_1": record}, tmp_path / "bag", recorded_settings)


def test_a_folder_that_exists_is_kept_and_one_that_fails_is_removed(short_flight, bag, tmp_path):
    """Catches an export that deletes a user's folder, or leaves half of one."""
    with pytest.raises(OutputError, match="File exists"):
        write_bag({"": short_flight[1]}, bag, recorded_settings)

    def fails(_):
        raise ConfigError("no settings")

    with pytest.raises(ConfigError, match="no settings"):
        write_bag({"": short_flight[1]}, tmp_path / "bag", fails)
    assert list(tmp_path.iterdir()) == []


def test_an_alarm_is_told_at_once_and_for_five_seconds(short_flight):
    record = short_flight[1]
    flight = RosFlight("uav1", recorded_settings, metadata_of(record), 0.0)
    alarm = Alarm(Violation.CAPTURE_LATER, 2.5)
    told = []
    entries = list(islice(cycles_of(record), 500))
    alarmed_s = entries[10].now_s
    entries[10] = entries[10]._replace(alarm=alarm)
    for entry in entries:
        for _, content in flight.cycle(entry, {DIAGNOSTICS}):
            told.append((entry.now_s, content.status[2].level, content.status[2].message))
    warned_s = [now_s - alarmed_s for now_s, level, _ in told if level == 1]
    assert (warned_s[0], warned_s[-1]) == (0.0, pytest.approx(5.0, abs=1.0))
    assert {words for _, level, words in told if level == 1} == {alarm.words}
    assert told[-1][2] == "none now"


def test_the_example_draws_a_bag(bag, tmp_path, capsys):
    """Catches an example of the documentation that no longer runs."""
    picture = tmp_path / "bag.png"
    example = Path(__file__).parents[2] / "docs" / "examples" / "draw_bag.py"
    runpy.run_path(str(example))["main"](str(bag), str(picture))
    assert capsys.readouterr().out.strip() == str(picture)
    assert picture.stat().st_size > 20_000


def test_without_rosbags_the_extra_is_named(short_flight, tmp_path, monkeypatch):
    monkeypatch.setattr("guidance.extras.find_spec", lambda _: None)
    with pytest.raises(ConfigError, match=r"needs rosbags.*pursuit-guidance\[ros\]"):
        write_bag({"": short_flight[1]}, tmp_path / "bag", recorded_settings)
