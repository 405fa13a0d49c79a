"""ROS 2 sees a flight as one of its own nodes: judged by zenoh-ros2-sdk, on a router of these tests."""

import struct
import threading
from collections import Counter
from contextlib import ExitStack, closing, contextmanager
from datetime import datetime
from itertools import count, islice

import pytest
import xxhash
import zenoh
from zenoh_ros2_sdk import get_service_names_and_types, get_topic_names_and_types
from zenoh_ros2_sdk.discovery import get_topic_info

from guidance.clock import VirtualClock
from guidance.config import parse_document
from guidance.errors import ConfigError
from guidance.flight import State
from guidance.frames import Amsl, LocalFrame
from guidance.links.evaders.zenoh import open_source
from guidance.links.zenoh import ros_types
from guidance.log import cycles_of, metadata_of
from guidance.log.ros import ODOMETRY_TOPIC, TOPICS, RosFlight, topic_name
from guidance.session.flight_files import recorded_settings
from guidance.session.observe.outputs import OutputOrder, open_outputs
from guidance.session.observe.ros import MOST_TOPICS_WAITING, ORDER_SERVICES, RosOutput, open_ros
from guidance.session.orders.mailbox import Mailbox
from guidance.session.vehicle_file import Config
from tests.harness.ros_client import TRIGGER, hash_of, ros_client, service_hash
from tests.harness.ros_witness import NAME, Witness
from tests.harness.vehicle import document
from tests.links.peer import until
from tests.links.rigs import clock, free_port, router, router_config
from tests.session.conftest import HERE

DOMAIN = 7
STARTED = "2026-03-01T12:00:00.250+00:00"
STARTED_NS = round(datetime.fromisoformat(STARTED).timestamp() * 1e9)


@pytest.fixture(scope="module")
def graph():
    """A router, and on it a client of ROS 2 that is not ours."""
    with router() as opened, ros_client(opened.port, DOMAIN) as client:
        yield opened, client


def config_of(port, **ros):
    section = {"endpoint": f"tcp/127.0.0.1:{port}", "domain_id": DOMAIN, **ros}
    return parse_document(Config, document(ros=section), source="test")


@contextmanager
def output(port, record, mailbox=None, name=NAME, **ros):
    """Open the output of a vehicle that flies a recorded flight."""
    metadata = {**metadata_of(record), "started_utc": STARTED}
    box = Mailbox() if mailbox is None else mailbox
    config = config_of(port, **ros)
    with closing(open_ros(name, metadata, VirtualClock(), box, config.ros, config)) as sink:
        yield sink


def tokens(opened, kind):
    replies = opened.session.liveliness().get(f"@ros2_lv/{DOMAIN}/*/*/*/{kind}/**", timeout=1.0)
    return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]


def test_a_late_subscriber_hears_every_topic_as_the_record_has_it(graph, short_flight):
    """Catches ROS messages that differ from the record."""
    opened, client = graph
    record = short_flight[1]
    entries = list(cycles_of(record))
    engaged = next(n for n, entry in enumerate(entries) if entry.state is State.ENGAGED)
    expected = RosFlight(
        NAME, recorded_settings, {**metadata_of(record), "started_utc": STARTED}, STARTED_NS * 1e-9
    )
    heard = []
    with output(opened.port, record) as sink:

        def told(part, wanted):
            """Tell the output of some cycles, and wait until all that it publishes of them was heard."""
            for begin in range(0, len(part), MOST_TOPICS_WAITING // 8):
                some = part[begin : begin + MOST_TOPICS_WAITING // 8]
                due = len(heard)
                for entry in some:
                    sink.cycle(entry)
                    due += sum(1 for _ in expected.cycle(entry, wanted))
                assert until(lambda due=due: sink.waiting == 0 and len(heard) >= due)

        told(entries[:engaged], ())
        assert until(lambda: len(sink.publishers) == len(TOPICS))
        for topic in TOPICS:
            name = topic_name(NAME, topic)
            client.subscribe(name, topic.type_name, lambda m, name=name: heard.append((name, m)))
        assert until(lambda: sink.wanted == set(TOPICS))
        told(entries[engaged : engaged + 300], TOPICS)
        assert sink.dropped == 0
    compared = Witness(record, STARTED_NS).compare(heard)
    assert set(compared) == {topic_name(NAME, topic) for topic in TOPICS} | {"isochron"}
    assert compared[f"/{NAME}/odometry"] >= 150


def test_the_graph_lists_node_topics_and_services_with_the_types_and_hashes_of_ros(
    graph, short_flight
):
    """Catches a type or hash that ROS would not match."""
    opened, client = graph
    with output(opened.port, short_flight[1], orders=True) as sink:
        assert until(lambda: len(tokens(opened, "SS")) == len(ORDER_SERVICES))
        listed = dict(get_topic_names_and_types(**client.at))
        for topic in TOPICS:
            name = topic_name(NAME, topic)
            assert topic.type_name in listed[name]
            (one,) = get_topic_info(name, verbose=True, **client.at).publishers
            assert (one.node_name, one.node_namespace) == ("guidance", f"/{NAME}")
            assert one.type_hash == hash_of(topic.type_name)
            assert one.qos in {"::,10:,:,:,,", "::,100:,:,:,,"}
        services = dict(get_service_names_and_types(**client.at))
        assert services == {f"/{NAME}/{order}": [TRIGGER] for order in ORDER_SERVICES}
        nodes = [token for token in tokens(opened, "NN") if token.endswith("/guidance")]
        assert [node.split("/0/0/")[1] for node in nodes] == [f"NN/%/%{NAME}/guidance"]
        _attachments(opened, short_flight[1], sink)
    assert until(lambda: tokens(opened, "MP") == [])


def _attachments(opened, record, sink):
    """Numbers count up from one; time is the flight's; the identity is the hash of the publisher's token."""
    heard = []
    key = f"{DOMAIN}/{NAME}/odometry/nav_msgs::msg::dds_::Odometry_/{hash_of(ros_types.ODOMETRY_TYPE)}"
    subscriber = opened.session.declare_subscriber(key, heard.append)
    assert until(lambda: ODOMETRY_TOPIC in sink.wanted)
    entries = list(cycles_of(record))[: MOST_TOPICS_WAITING - 1]
    for entry in entries:
        sink.cycle(entry)
    assert until(lambda: sink.waiting == 0 and len(heard) >= 15)
    subscriber.undeclare()
    parts = [struct.unpack("<qqB16s", sample.attachment.to_bytes()) for sample in heard]
    assert [number for number, *_ in parts] == list(range(1, len(parts) + 1))
    stamps = {STARTED_NS + round(entry.now_s * 1e9) for entry in entries}
    assert all(min(abs(time_ns - stamp) for stamp in stamps) < 1000 for _, time_ns, *_ in parts)
    (token,) = [one for one in tokens(opened, "MP") if f"/%{NAME}%odometry/" in one]
    hashed = xxhash.xxh3_128(token.encode())
    low_then_high = hashed.digest()[::-1]
    assert {(length, gid) for *_, length, gid in parts} == {(16, low_then_high)}


def test_services_do_and_refuse_what_guidance_ctl_does_and_are_off_by_default(graph, base):
    """Catches a ROS service that goes past the mailbox."""
    opened, client = graph
    one = base().standing_by()
    metadata = {"config": one.config.model_dump_json(), "started_utc": STARTED}

    def called(order):
        """Call a service while the daemon's cycles run."""
        answers = []
        thread = threading.Thread(target=lambda: answers.append(client.call(f"/uav1/{order}")))
        thread.start()
        assert until(lambda: one.mailbox.waiting_orders > 0 or not thread.is_alive())
        while thread.is_alive():
            one.cycle()
            thread.join(0.002)
        return answers[0]

    config = config_of(opened.port, orders=True)
    with closing(open_ros("uav1", metadata, one.clock, one.mailbox, config.ros)):
        assert until(lambda: len(tokens(opened, "SS")) == len(ORDER_SERVICES))
        assert called("engage").success
        one.until(State.ENGAGED)
        held = called("hold")
        assert (held.success, one.daemon.flight.state) == (True, State.HOLDING)
        assert held.message == "holding"
        assert called("land").success
        assert one.daemon.flight.state is State.LANDING
        refused = called("engage")
        assert not refused.success
        assert refused.message == one.order("engage")["reason"]
    by = [
        fields["by"]
        for _, message, fields in one.log.lines
        if message == "order" and "by" in fields
    ]
    assert Counter(who[:13] for who in by) == {"ROS 2 client ": 4}
    section = config_of(opened.port).ros
    with closing(open_ros("uav1", metadata, one.clock, one.mailbox, section)) as sink:
        assert until(lambda: len(sink.publishers) == len(TOPICS))
        assert tokens(opened, "SS") == []


def test_requests_that_are_none_are_dropped(graph, short_flight):
    opened, _ = graph
    asked = []
    mailbox = Mailbox()
    mailbox.meanwhile = lambda order: asked.append(order) or {"accepted": False, "reason": "no"}
    key = f"{DOMAIN}/{NAME}/hold/std_srvs::srv::dds_::Trigger_/{ros_types.TRIGGER_HASH}"
    with output(opened.port, short_flight[1], mailbox, orders=True):
        assert until(lambda: len(tokens(opened, "SS")) == len(ORDER_SERVICES))
        for attachment in (None, b"", bytes(32), struct.pack("<qqB16s", 1, 1, 15, bytes(16))):
            replies = opened.session.get(key, timeout=1.0, attachment=attachment)
            assert [reply.ok for reply in replies] == []
        assert asked == []
        good = struct.pack("<qqB16s", 5, 1, 16, b"0123456789abcdef")
        (reply,) = opened.session.get(key, timeout=2.0, attachment=good)
        sequence, _, _, gid = struct.unpack("<qqB16s", reply.ok.attachment.to_bytes())
        assert (sequence, gid, asked) == (5, b"0123456789abcdef", ["hold"])


def test_what_the_sdk_publishes_is_read_by_our_evader_sources(graph):
    opened, client = graph
    frame = LocalFrame(HERE[0], HERE[1], Amsl(HERE[2]))
    for kind, type_name in (
        ("ros_pose", ros_types.POSE_STAMPED),
        ("ros_odometry", ros_types.ODOMETRY_TYPE),
    ):
        url = f"zenoh://127.0.0.1:{opened.port}/evader/{kind}"
        publisher = client.publisher(f"/evader/{kind}", type_name)
        point = client.type_of("geometry_msgs/msg/Point")(50.0, 100.0, 20.0)
        turn = client.type_of("geometry_msgs/msg/Quaternion")(0.0, 0.0, 0.0, 1.0)
        pose = client.type_of("geometry_msgs/msg/Pose")(point, turn)
        stamp = client.type_of("builtin_interfaces/msg/Time")(10, 500_000_000)
        fields = {"header": client.type_of("std_msgs/msg/Header")(stamp, "map"), "pose": pose}
        if kind == "ros_odometry":
            fields |= _moving(client, pose)
        reports = []
        with closing(open_source(kind, url, clock=clock, frame=frame)) as source:

            def heard(publisher=publisher, fields=fields, source=source, reports=reports):
                publisher.publish(**fields)
                reports.extend(source.receive())
                return bool(reports)

            assert until(heard)
            assert source.counters()["reports"] == len(reports)
        report = reports[0]
        place = (report.latitude_deg, report.longitude_deg, Amsl(report.altitude_amsl_m))
        assert frame.ned_from_wgs84(*place) == pytest.approx((100.0, 50.0, -20.0), abs=1e-3)
        assert report.sent_s == 10.5
    assert report.velocity_ned_m_s == pytest.approx((1.0, 3.0, -0.5))


def _moving(client, pose):
    import numpy as np

    vector = client.type_of("geometry_msgs/msg/Vector3")
    twist = client.type_of("geometry_msgs/msg/Twist")(vector(3.0, 1.0, 0.5), vector(0.0, 0.0, 0.0))
    unknown = np.zeros(36)
    return {
        "child_frame_id": "base_link",
        "pose": client.type_of("geometry_msgs/msg/PoseWithCovariance")(pose, unknown),
        "twist": client.type_of("geometry_msgs/msg/TwistWithCovariance")(twist, unknown),
    }


def test_the_hashes_of_the_independent_sdk_are_those_in_rmw_zenohs_documentation():
    assert hash_of("std_msgs/msg/String").startswith("RIHS01_df668c740482bbd48fb39d76a70dfd4b")
    add = service_hash("example_interfaces/srv/AddTwoInts", "int64 a\nint64 b\n", "int64 sum\n")
    assert add.startswith("RIHS01_e118de6bf5eeb66a2491b5bda11202e7")
    trigger = service_hash(TRIGGER, "# nothing\n", "bool success\nstring message\n")
    assert trigger == ros_types.hash_of(TRIGGER)


def test_a_router_that_comes_late_and_one_that_restarts_are_joined(short_flight, monkeypatch):
    monkeypatch.setattr("guidance.session.observe.ros.RETRY_S", 0.1)
    port = free_port()
    entries = list(islice(cycles_of(short_flight[1]), MOST_TOPICS_WAITING))
    later_s = count(entries[-1].now_s, 0.04)
    with output(port, short_flight[1]) as sink:
        for entry in entries:
            sink.cycle(entry)
        assert until(lambda: sink.waiting == 0)
        for _ in range(2):
            with zenoh.open(router_config(port)) as session:
                heard = []
                session.declare_subscriber(f"{DOMAIN}/{NAME}/odometry/**", heard.append)

                def published(heard=heard, sink=sink):
                    sink.cycle(entries[-1]._replace(now_s=next(later_s)))
                    return bool(heard)

                assert until(published, timeout_s=8.0)
                replies = session.liveliness().get(f"@ros2_lv/{DOMAIN}/**", timeout=1.0)
                assert sum(reply.ok is not None for reply in replies) == 1 + len(TOPICS)


@pytest.mark.parametrize(
    ("ros", "words"),
    [
        ({"endpoint": "tcp/192.168.1.10:7447", "orders": True}, "anyone could command the vehicle"),
        ({"endpoint": "tls/192.168.1.10:7447"}, "needs zenoh.tls_ca_file"),
        ({"endpoint": "udp/127.0.0.1"}, "ros.endpoint"),
        ({"domain_id": 233}, "ros.domain_id"),
    ],
)
def test_a_section_that_is_wrong_names_its_key(ros, words):
    with pytest.raises(ConfigError, match=words):
        parse_document(Config, document(ros=ros), source="test")


def test_a_vehicle_file_with_the_section_and_a_mocked_flight_that_asks_open_the_output(
    short_flight,
):
    order = OutputOrder(
        "uav1",
        metadata_of(short_flight[1]),
        VirtualClock(),
        link=None,
        mailbox=Mailbox(),
        config=config_of(free_port()),
    )
    mocked = order._replace(config=None, ros=config_of(free_port()).ros)
    for asked in (order, mocked):
        with ExitStack() as stack:
            (sink,) = open_outputs(asked, stack)
            assert isinstance(sink, RosOutput)
        assert "ros" not in {thread.name for thread in threading.enumerate()}


def test_without_the_section_nothing_of_ros_is_opened_and_without_the_extra_it_is_named(
    monkeypatch,
):
    config = parse_document(Config, document(), source="test")
    for asked in (config, None):
        order = OutputOrder("uav1", {}, VirtualClock(), None, Mailbox(), asked)
        with ExitStack() as stack:
            assert open_outputs(order, stack) == []
    monkeypatch.setattr("guidance.extras.find_spec", lambda _: None)
    with pytest.raises(ConfigError, match=r"pursuit-guidance\[ros\]"):
        open_ros("uav1", {}, VirtualClock(), Mailbox(), config_of(7447).ros)
