"""Faults of links: frames to and from a vehicle, with one fault at a time."""

import itertools
import math

import pytest
from pymavlink.dialects.v20 import all as dialect

from sitl_mock.faults import KINDS
from sitl_mock.mavlink import Decoder, Signing

LONG = "x" * 120


def rate_hz(rig, name, since_s, until_s):
    return len(rig.all(name, since_s, until_s)) / (until_s - since_s)


def test_loss_takes_its_share_of_the_messages_named_and_of_no_others(rig):
    """Catches a loss of the wrong share or message."""
    flight = rig({"kind": "loss", "probability": 0.3, "messages": ["ATTITUDE"]}).run(20.0)
    assert rate_hz(flight, "ATTITUDE", 0, 20) == pytest.approx(70.0, abs=6.0)
    assert rate_hz(flight, "HIGHRES_IMU", 0, 20) == pytest.approx(50.0, abs=0.2)


def test_a_fault_begins_and_ends_at_its_own_times_within_a_callers_step(rig):
    flight = rig({"kind": "loss", "at_s": 1.015, "for_s": 0.99}, dt_s=0.5)
    whole = rig(dt_s=0.5)
    for each in (flight, whole):
        each.run(3.0)
    stamps = [{m.time_boot_ms for _, m in each.all("ATTITUDE")} for each in (flight, whole)]
    assert sorted(stamps[1] - stamps[0]) == list(range(1020, 2005, 10))


def test_commands_lost_on_their_way_in_are_never_obeyed(rig):
    flight = rig({"kind": "loss", "direction": "in", "messages": ["COMMAND_LONG"]}).run(1.0)
    assert flight.command(400, 1.0) == []
    assert not flight.vehicle.armed


def test_duplicates_are_equal_to_the_byte_and_come_as_late_as_asked(rig):
    flight = rig({"kind": "duplicate", "messages": ["SYS_STATUS"], "late_s": 0.1, "copies": 2}).run(
        2.0
    )
    came = [(t, f) for t, f in flight.frames if f[7:10] == b"\1\0\0"]
    first = came[0]
    assert [t - first[0] for t, f in came if f == first[1]] == pytest.approx([0.0, 0.1, 0.1])


def test_reordered_frames_are_overtaken_but_none_is_lost(rig):
    flight = rig(
        {"kind": "reorder", "messages": ["ATTITUDE"], "probability": 0.3, "by_s": 0.05}
    ).run(5.0)
    stamps = [m.time_boot_ms for _, m in flight.all("ATTITUDE")]
    assert stamps != sorted(stamps)
    assert len(stamps) == len(set(stamps))
    assert set(range(10, 4900, 10)) <= set(stamps)


def test_delay_is_the_least_and_jitter_comes_on_top(rig):
    flight = rig(
        {"kind": "delay", "messages": ["ATTITUDE"], "delay_s": 0.2, "jitter_s": 0.1}, dt_s=0.01
    ).run(5.0)
    ages = [t - m.time_boot_ms * 1e-3 for t, m in flight.all("ATTITUDE")]
    assert 0.2 - 1e-9 <= min(ages) < 0.22
    assert 0.28 < max(ages) <= 0.31


def test_a_delay_without_jitter_keeps_the_order(rig):
    flight = rig({"kind": "delay", "delay_s": 0.3}).run(3.0)
    stamps = [m.time_boot_ms for _, m in flight.all("ATTITUDE")]
    assert stamps == sorted(stamps)


@pytest.mark.parametrize("bits", [1, 2, 3])
def test_corrupt_frames_are_refused_by_pymavlink_and_by_the_vehicle(rig, bits):
    both = {"kind": "corrupt", "bits": bits, "direction": "both", "at_s": 1.0}
    flight = rig(both).run(1.0)
    heard = len(flight.heard)
    flight.run(0.5)
    assert flight.command(400, 1.0) == []
    assert not flight.vehicle.armed
    assert flight.vehicle.counters()["onboard"]["crc"] == 1
    known = [m for _, m in flight.heard[heard:] if not m.get_type().startswith("UNKNOWN")]
    assert known == [], "pymavlink can only check the messages that it knows"
    assert flight.broken > 100


@pytest.mark.parametrize("gap_s", [2.9, 3.1])
def test_a_heartbeat_gap_is_as_long_as_asked_comes_once_and_lets_the_rest_pass(rig, gap_s):
    flight = rig({"kind": "heartbeat_gap", "at_s": 5.5, "gap_s": gap_s}).run(14.0)
    times = [t for t, _ in flight.all("HEARTBEAT")]
    gaps = sorted(b - a for a, b in itertools.pairwise(times))
    assert gaps[-1] == pytest.approx(gap_s, abs=0.021)
    assert gaps[-2] == pytest.approx(1.0, abs=0.021)
    assert rate_hz(flight, "ATTITUDE", 6.0, 9.0) == pytest.approx(100.0, abs=2.0)


def test_v1_frames_carry_the_same_values_without_extensions(rig):
    flight = rig({"kind": "v1_frames"}).run(2.0)
    assert {frame[0] for _, frame in flight.frames} == {0xFE}
    assert flight.broken == 0
    (_, status) = flight.all("SYS_STATUS")[0]
    assert len(status.get_msgbuf()) == 8 + 31
    assert rate_hz(flight, "ATTITUDE", 0, 2) == pytest.approx(100.0, abs=2.0)
    assert flight.all("CURRENT_MODE") == []  # id 436 does not fit


def test_signed_frames_check_under_their_key_and_fail_under_another(rig):
    flight = rig({"kind": "signed_frames", "key_byte": 9}).run(1.0)
    for byte, good in ((9, len(flight.frames)), (8, 0)):
        decoder = Decoder(signing=Signing(bytes((byte,)) * 32))
        messages = [m for _, frame in flight.frames for m in decoder.feed(frame, whole=True)]
        assert len(messages) == good
    assert len(flight.heard) == len(flight.frames)  # who does not check takes them


@pytest.mark.parametrize(
    ("kind", "keys", "came", "armed"),
    [
        ("ack_lost", {}, [], True),
        ("ack_lost", {"commands": [22]}, [(1, 0)], True),
        ("ack_wrong", {"result": 2}, [(1, 2)], True),
        ("ack_in_progress", {}, [(1, 5)], True),
        ("ack_foreign", {"component": 191}, [(191, 0)], True),
        ("ack_late", {"delay_s": 1.0}, [], True),
    ],
)
def test_the_answer_is_wrong_but_the_command_was_obeyed(rig, kind, keys, came, armed):
    flight = rig({"kind": kind, **keys}).run(1.5)
    assert flight.command(400, 1.0) == came
    assert flight.vehicle.armed == armed


def test_a_late_ack_comes_when_it_was_said_to(rig):
    flight = rig({"kind": "ack_late", "delay_s": 0.7}).run(1.5)
    asked_s = flight.now_s
    flight.command(400, 1.0, wait_s=2.0)
    ((came_s, _),) = flight.all("COMMAND_ACK")
    assert came_s - asked_s == pytest.approx(0.7, abs=0.03)


def test_in_progress_is_followed_by_silence_also_when_the_command_is_sent_again(rig):
    flight = rig({"kind": "ack_in_progress", "progress": 40}).run(1.5)
    assert flight.command(400, 1.0) == [(1, 5)]
    assert flight.all("COMMAND_ACK")[0][1].progress == 40
    assert flight.command(400, 1.0) == []


def test_px4_answers_a_mode_change_twice_and_both_are_struck(rig):
    flight = rig({"kind": "ack_wrong", "result": 4}).run(1.0)
    assert flight.command(176, 1.0, 4.0, 3.0) == [(1, 4), (1, 4)]


def test_fields_become_nan_where_a_field_can(rig):
    flight = rig(
        {"kind": "bad_fields", "messages": ["LOCAL_POSITION_NED"], "fields": ["vx", "z"]}
    ).run(1.0)
    (_, message) = flight.all("LOCAL_POSITION_NED")[-1]
    assert math.isnan(message.vx)
    assert math.isnan(message.z)
    assert math.isfinite(message.x)
    assert message.time_boot_ms > 0


def test_whole_numbers_become_the_largest_of_their_type_and_the_stamp_stays(rig):
    flight = rig(
        {"kind": "bad_fields", "messages": ["GLOBAL_POSITION_INT"], "value": "int_max"}
    ).run(1.0)
    (_, message) = flight.all("GLOBAL_POSITION_INT")[-1]
    assert (message.lat, message.alt, message.vx, message.hdg) == (
        2**31 - 1,
        2**31 - 1,
        2**15 - 1,
        2**16 - 1,
    )
    assert message.time_boot_ms < 2000


def test_a_place_of_zero_is_sent_as_such(rig):
    flight = rig({"kind": "latlon_zero"}).run(1.0)
    assert {(m.lat, m.lon) for _, m in flight.all("GLOBAL_POSITION_INT")} == {(0, 0)}
    assert {(m.lat, m.lon) for _, m in flight.all("GPS_RAW_INT")} == {(0, 0)}
    assert all(m.alt > 400_000 for _, m in flight.all("GLOBAL_POSITION_INT"))


@pytest.mark.parametrize(
    ("flavour", "name"),
    [("px4", "COM_OBL_RC_ACT"), ("px4", "COM_OF_LOSS_T"), ("arducopter", "WPNAV_SPEED")],
)
def test_a_parameter_is_echoed_with_another_value_than_it_has(rig, flavour, name):
    flight = rig({"kind": "param_echo", "parameter": name, "value": 5}, flavour=flavour).run(1.0)
    before = flight.vehicle.autopilot.parameters[name]
    flight.send("PARAM_REQUEST_READ", 1, 1, name.encode(), -1)
    (_, message) = flight.all("PARAM_VALUE")[-1]
    raw = message.get_msgbuf()[10:14]
    assert message.param_value == 5.0 or int.from_bytes(raw, "little") == 5
    assert flight.vehicle.autopilot.parameters[name] == before != 5


def test_time_since_boot_begins_again_without_the_autopilot_noticing(rig):
    flight = rig({"kind": "time_reset", "at_s": 3.0}).run(4.0)
    stamps = [m.time_boot_ms for _, m in flight.all("ATTITUDE")]
    falls = [(a, b) for a, b in itertools.pairwise(stamps) if b < a]
    assert falls == [(pytest.approx(3000, abs=20), pytest.approx(0, abs=20))]
    assert flight.vehicle.autopilot.boots == 1


def test_time_boot_ms_wraps_when_it_was_said_to(rig):
    flight = rig({"kind": "time_wrap", "before_s": 2.0, "at_s": 1.0}).run(5.0)
    falls = [
        (t, a.time_boot_ms, b.time_boot_ms)
        for (_, a), (t, b) in zip(flight.all("ATTITUDE"), flight.all("ATTITUDE")[1:], strict=False)
        if b.time_boot_ms < a.time_boot_ms
    ]
    ((at_s, last, first),) = falls
    assert at_s == pytest.approx(3.0, abs=0.05)
    assert last > 2**32 - 20
    assert first < 20


def test_another_component_claims_a_mode_in_a_heartbeat_of_its_own(rig):
    flight = rig({"kind": "foreign_heartbeat", "component": 191, "mode": "OFFBOARD"}).run(3.0)
    claims = [m for _, m in flight.all("HEARTBEAT") if m.get_srcComponent() == 191]
    assert len(claims) in {3, 4}
    assert {(m.custom_mode, m.base_mode & 1, m.get_srcSystem()) for m in claims} == {
        (6 << 16, 1, 1)
    }
    assert flight.vehicle.mode == "HOLD"


def test_two_vehicles_with_the_same_id_answer_the_same_command(rig):
    flight = rig({"kind": "sysid_clash", "north_m": 500.0}).run(2.0)
    assert flight.command(400, 1.0) == [(1, 0), (1, 0)]
    places = {round(m.lat * 1e-7, 3) for _, m in flight.all("GLOBAL_POSITION_INT", 1.5)}
    assert len(places) == 2


def test_a_forger_reports_displaced_positions_between_the_true_ones(rig):
    flight = rig({"kind": "position_forger", "north": 40.0, "ahead_s": 0.3, "at_s": 1.0}).run(2.0)
    said = [m for at_s, m in flight.all("LOCAL_POSITION_NED") if at_s > 1.1]
    pairs = list(zip(said[::2], said[1::2], strict=False))
    assert len(pairs) > 10
    for true, forged in pairs:
        assert forged.x - true.x == pytest.approx(40.0, abs=0.01)
        assert forged.time_boot_ms - true.time_boot_ms == 300
        assert forged.get_srcSystem() == true.get_srcSystem()


@pytest.mark.parametrize("lost", [-1, 1])
def test_a_long_text_comes_in_chunks_of_which_one_may_be_missing(rig, lost):
    flight = rig({"kind": "statustext", "text": LONG, "lost_chunk": lost, "at_s": 1.0}).run(2.0)
    chunks = [m for _, m in flight.all("STATUSTEXT")]
    assert [m.chunk_seq for m in chunks] == [n for n in (0, 1, 2) if n != lost]
    assert len({m.id for m in chunks}) == 1
    assert chunks[0].id != 0
    if lost < 0:
        assert "".join(m.text for m in chunks) == LONG


def test_a_router_that_restarts_cuts_both_directions(rig):
    flight = rig({"kind": "router_restart", "at_s": 2.0, "for_s": 1.0}).run(2.5)
    assert flight.command(400, 1.0) == []
    assert not flight.vehicle.armed
    flight.run(1.0)
    assert rate_hz(flight, "ATTITUDE", 2.02, 3.0) == 0.0
    assert rate_hz(flight, "ATTITUDE", 3.04, 3.6) > 90.0
    assert list(flight.faulted.transport) == [("router_restart", 1.0)]


def test_altered_frames_of_a_vehicle_that_signs_are_signed_again(rig):
    signing = Signing(bytes(range(32)))
    flight = rig(
        {"kind": "bad_fields", "messages": ["LOCAL_POSITION_NED"], "fields": ["x"]}, signing=signing
    ).run(1.0)
    decoder = Decoder(signing=Signing(bytes(range(32))))
    names = [m.get_type() for _, frame in flight.frames for m in decoder.feed(frame, whole=True)]
    assert names.count("LOCAL_POSITION_NED") >= 29
    assert decoder.counts.wrong_key == decoder.counts.crc == 0


def test_frames_of_every_kind_of_fault_are_valid_unless_the_fault_damages_them(rig):
    """Catches a fault that forgets the checksum."""
    needs = {"ack_wrong": {"result": 3}, "param_echo": {"parameter": "COM_OF_LOSS_T", "value": 1}}
    for name, kind in KINDS.items():
        if kind.scope is None or name in {"corrupt", "router_restart"}:
            continue
        flight = rig({"kind": name, **needs.get(name, {})}).run(1.5)
        flight.command(400, 1.0)
        assert flight.broken == 0, name
        assert name in {"loss", "delay"} or any(
            isinstance(m, dialect.MAVLink_message) for _, m in flight.heard
        ), name
