"""Evaders on Zenoh keys: JSON after the published schema, and ROS 2 poses in CDR written here from its definition."""

import json
import math
import struct
from functools import partial
from pathlib import Path

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from guidance.errors import ConfigError, LinkError
from guidance.frames import Amsl, LocalFrame
from guidance.links.evaders.carriers import RefusedReport
from guidance.links.evaders.zenoh import (
    JsonReport,
    ZenohEvader,
    open_source,
    read_ros,
    report_of_json,
    rmw_key,
)
from guidance.links.zenoh.session import open_session
from tests.links.peer import until
from tests.links.rigs import clock, free_port

FRAME = LocalFrame(47.3977418, 8.5455939, Amsl(488.0), home=Amsl(490.0), undulation_m=47.3)
GOOD = {
    "sent_s": 12.5,
    "latitude_deg": 47.4,
    "longitude_deg": 8.5,
    "altitude_m": 600.0,
    "altitude_datum": "amsl",
    "velocity_ned_m_s": [1.0, -2.0, 0.5],
    "position_sd_m": 1.5,
    "velocity_sd_m_s": 0.2,
}
read = partial(report_of_json, frame=FRAME, source="evader")
pose, moving_pose = (partial(read_ros, frame=FRAME, moves=moves) for moves in (False, True))


def as_bytes(**changes) -> bytes:
    return json.dumps(
        {key: value for key, value in (GOOD | changes).items() if value != "absent"}
    ).encode()


def test_the_published_schema_is_the_models():
    published = Path(__file__).parents[3] / "config" / "zenoh" / "evader_report.schema.json"
    own = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **JsonReport.model_json_schema(),
    }
    assert json.loads(published.read_text()) == own


def test_a_report_says_its_units_and_its_datum():
    report = read(as_bytes(), 3.0)
    assert report == (
        3.0,
        12.5,
        "evader",
        47.4,
        8.5,
        600.0,
        (1.0, -2.0, 0.5),
        1.5,
        0.2,
        None,
        (600.0, "amsl"),
        None,
        None,
        None,
        None,
    )


@pytest.mark.parametrize(
    ("datum", "amsl_m"), [("amsl", 600.0), ("ellipsoid", 552.7), ("relative", 1090.0)]
)
def test_every_datum_becomes_height_above_the_sea(datum, amsl_m):
    report = read(as_bytes(altitude_datum=datum), 0.0)
    assert report.altitude_amsl_m == pytest.approx(amsl_m)
    assert report.said == (600.0, datum)


@pytest.mark.parametrize("absent", [None, "absent"])
def test_unknown_values_are_nan(absent):
    unknown = dict.fromkeys(
        ("sent_s", "velocity_ned_m_s", "position_sd_m", "velocity_sd_m_s"), absent
    )
    report = read(as_bytes(**unknown), 0.0)
    assert math.isnan(report.sent_s)
    assert all(map(math.isnan, report.velocity_ned_m_s))
    assert math.isnan(report.position_sd_m)
    assert math.isnan(report.velocity_sd_m_s)


def test_zero_velocity_in_json_is_zero():
    assert read(as_bytes(velocity_ned_m_s=[0, 0, 0]), 0.0).velocity_ned_m_s == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "schema"),
        (b"\xff\xfe", "schema"),
        (b"[]", "schema"),
        (as_bytes(altitude_datum="absent"), "schema"),
        (as_bytes(altitude_datum="msl"), "schema"),
        (as_bytes(latitude_deg=91.0), "schema"),
        (as_bytes(latitude_deg="47.4"), "schema"),
        (as_bytes(longitude_deg=float("nan")), "schema"),
        (as_bytes(altitude_m=float("inf")), "schema"),
        (as_bytes(velocity_ned_m_s=[1.0, 2.0]), "schema"),
        (as_bytes(velocity_ned_m_s=[1.0, 2.0, float("nan")]), "schema"),
        (as_bytes(position_sd_m=0.0), "schema"),
        (as_bytes(altitude=600.0), "schema"),
        (as_bytes(latitude_deg=0.0, longitude_deg=0.0), "position"),
    ],
)
def test_payloads_that_violate_the_schema_are_refused(payload, reason):
    with pytest.raises(RefusedReport) as caught:
        read(payload, 0.0)
    assert str(caught.value) == reason


def test_a_datum_that_this_frame_cannot_turn_is_refused():
    bare = LocalFrame(47.0, 8.0, Amsl(488.0))
    for datum in ("ellipsoid", "relative"):
        with pytest.raises(RefusedReport, match="datum"):
            report_of_json(as_bytes(altitude_datum=datum), 0.0, frame=bare, source="x")


@given(st.binary(max_size=200))
def test_no_bytes_do_harm(payload):
    for reader in (read, pose, moving_pose):
        with pytest.raises(RefusedReport):
            reader(payload, 0.0)


class Cdr:
    """CDR as OMG's DDS-XTYPES 7.4.1 defines it, both byte orders."""

    def __init__(self, order: str) -> None:
        self.order = order
        self.body = b""

    def put(self, code: str, *values) -> "Cdr":
        size = struct.calcsize(code)
        for value in values:
            self.body += bytes(-len(self.body) % size) + struct.pack(self.order + code, value)
        return self

    def text(self, value: str) -> "Cdr":
        raw = value.encode() + b"\0"
        self.put("I", len(raw))
        self.body += raw
        return self

    def done(self) -> bytes:
        return (b"\x00\x01\x00\x00" if self.order == "<" else b"\x00\x00\x00\x00") + self.body


def pose_stamped(
    order="<", frame="map", stamp=(10, 500_000_000), position=(50.0, 100.0, 20.0)
) -> bytes:
    return (
        Cdr(order)
        .put("i", stamp[0])
        .put("I", stamp[1])
        .text(frame)
        .put("d", *position, 0, 0, 0, 1)
        .done()
    )


def odometry(order="<", child="base_link", yaw=0.0, twist=(3.0, 1.0, 0.5), variance=0.25) -> bytes:
    cdr = Cdr(order).put("i", 10).put("I", 0).text("map").text(child)
    cdr.put("d", 50.0, 100.0, 20.0, 0, 0, math.sin(yaw / 2), math.cos(yaw / 2))
    covariance = [0.0] * 36
    covariance[0] = variance
    covariance[7] = variance / 4
    covariance[14] = variance
    return cdr.put("d", *covariance, *twist, 0, 0, 0, *[0.0] * 36).done()


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("frame", ["map", "m", "odometry_frame"])
def test_a_ros_pose_is_east_north_up_about_the_origin(order, frame):
    report = pose(pose_stamped(order, frame), 4.0, frame_id=frame)
    ned = FRAME.ned_from_wgs84(
        report.latitude_deg, report.longitude_deg, Amsl(report.altitude_amsl_m)
    )
    assert ned == pytest.approx((100.0, 50.0, -20.0), abs=1e-3)
    assert (report.received_s, report.sent_s) == (4.0, 10.5)
    assert all(map(math.isnan, report.velocity_ned_m_s))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("child", ["base_link", "b", ""])
@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, 180.0, -90.0])
def test_a_ros_twist_is_forward_left_up_of_a_body_whose_yaw_counts_from_east(order, child, yaw_deg):
    yaw = math.radians(yaw_deg)
    report = moving_pose(odometry(order, child, yaw), 4.0)
    east = 3.0 * math.cos(yaw) - 1.0 * math.sin(yaw)
    north = 3.0 * math.sin(yaw) + 1.0 * math.cos(yaw)
    assert report.velocity_ned_m_s == pytest.approx((north, east, -0.5), abs=1e-9)
    assert report.position_sd_m == 0.5
    assert math.isnan(report.velocity_sd_m_s)


def test_a_ros_stamp_of_zero_is_no_stamp():
    assert math.isnan(pose(pose_stamped(stamp=(0, 0)), 0.0).sent_s)


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (pose_stamped(frame="odom"), 'frame_id "odom" instead of evader.frame_id = "map"'),
        (pose_stamped(position=(math.nan, 0.0, 0.0)), "position"),
        (pose_stamped(position=(1e300, 0.0, 0.0)), "position"),
        (b"\x00\x07" + pose_stamped()[2:], "encoding"),
        (pose_stamped()[:12] + b"\xff\xff\xff\xff" + pose_stamped()[16:], "encoding"),
        (pose_stamped()[:12] + b"\x00\x00\x00\x00" + pose_stamped()[16:], "encoding"),
        (pose_stamped()[:16] + b"mapX" + pose_stamped()[20:], "encoding"),
    ],
)
def test_a_ros_pose_that_is_none_is_refused(payload, reason):
    with pytest.raises(RefusedReport) as caught:
        pose(payload, 0.0)
    assert str(caught.value) == reason


@given(st.integers(0, len(odometry()) - 1))
def test_ros_messages_cut_anywhere_are_refused(length):
    with pytest.raises(RefusedReport):
        moving_pose(odometry()[:length], 0.0)


@pytest.mark.parametrize(
    ("kind", "path", "key", "payload"),
    [
        ("json", "evaders/evader", "evaders/evader", as_bytes()),
        (
            "ros_pose",
            "evader/pose",
            "0/evader/pose/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_10f378",
            pose_stamped(),
        ),
        (
            "ros_odometry",
            "evader/odom",
            "7/evader/odom/nav_msgs::msg::dds_::Odometry_/RIHS01_3cc97d",
            odometry(),
        ),
    ],
)
def test_an_evader_is_received_from_its_zenoh_key_only(router, kind, path, key, payload):
    url = f"zenoh://127.0.0.1:{router.port}/{path}"
    source = open_source(kind, url, clock=clock, frame=FRAME)
    reports = []
    try:
        before_s = clock()

        def heard() -> bool:
            router.session.put(key, payload)
            router.session.put(key + "x/other", payload)
            router.session.put(key, b"garbage")
            reports.extend(source.receive())
            return len(reports) >= 3

        assert until(heard)
        assert all(report.received_s >= before_s for report in reports)
        counters = source.counters()
        assert counters["reports"] == len(reports)
        assert sum(n for name, n in counters.items() if name.startswith("refused")) >= 1
    finally:
        source.close()
        source.close()
    router.session.put(key, payload)
    assert source.receive() == []


@pytest.mark.parametrize("kind", ["ros_pose", "ros_odometry"])
def test_ros_messages_without_the_package_that_reads_them_are_a_clear_error(monkeypatch, kind):
    monkeypatch.setattr("guidance.extras.find_spec", lambda _: None)
    with pytest.raises(ConfigError, match=rf"{kind}.*needs rosbags.*pursuit-guidance\[ros\]"):
        open_source(kind, "zenoh://127.0.0.1:7447/evader", clock=clock, frame=FRAME)


def test_a_bad_url_of_a_source_is_named():
    with pytest.raises(ConfigError, match="nonsense"):
        open_source("json", "nonsense", clock=clock, frame=FRAME)


def test_a_source_without_a_router_is_a_clear_error():
    with pytest.raises(LinkError, match=r"no session within 0\.2 s"):
        open_source(
            "json",
            f"zenoh://127.0.0.1:{free_port()}/t",
            clock=clock,
            frame=FRAME,
            timeout_s=0.2,
        )


def test_a_key_that_is_none_is_a_config_error(router):
    with pytest.raises(ConfigError, match="not a Zenoh key expression"):
        ZenohEvader(clock, open_session(f"tcp/127.0.0.1:{router.port}"), "/bad//key", read)


def test_rmw_keys_hold_any_domain_and_any_hash():
    key = zenoh.KeyExpr(rmw_key("/evader/pose/", "geometry_msgs/msg/PoseStamped"))
    assert key.intersects(
        zenoh.KeyExpr("42/evader/pose/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_00")
    )
    assert not key.intersects(
        zenoh.KeyExpr("42/other/pose/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_00")
    )
