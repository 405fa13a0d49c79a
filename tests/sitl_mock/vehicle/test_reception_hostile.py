"""Hostile traffic against flying vehicles, with a fixed budget; `tests/bench/fuzz_mock.py` fires a million.

The oracle is a twin: the same client flies two equal vehicles, one of them under hostile traffic. Their output must be
identical, so dropped input leaves no trace.
"""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as dialect

from sitl_mock.mavlink import MAX_FRAME, SPEC_BY_ID, Decoder, Encoder, Signing
from sitl_mock.vehicle.mock_vehicle import MockVehicle
from tests.harness.examples import drawn
from tests.sitl_mock.vehicle.hostile import TARGETS, WRONG_KEY, HostileTraffic
from tests.sitl_mock.vehicle.newer_messages import NEWER

KEY = bytes(range(32))
FLAVOURS = ("px4", "arducopter", "rover")
GUIDED = {"px4": (1.0, 6.0), "arducopter": (1.0, 4.0), "rover": (1.0, 15.0)}
STEP_S = 0.05
TICKS = 150
FRAMES_PER_TICK = 60
SETUP_SIGNING = 256


@pytest.fixture(scope="module", autouse=True)
def pymavlink_of_today():
    """pymavlink's own parser, told of the messages that its dialects lack: the classes go into its table."""
    with pytest.MonkeyPatch.context() as patch:
        for message_id, message_class in NEWER.items():
            patch.setitem(dialect.mavlink_map, message_id, message_class)
        yield


class Client:
    """Flies a vehicle: streams a velocity, asks for guided flight, arms, takes off."""

    def __init__(self, flavour, key=None):
        self.flavour = flavour
        self.encoder = Encoder(
            255, 190, signing=Signing(key, timestamp=10**9) if key else None, link_id=5
        )

    def command(self, number, *params):
        return self.encoder.pack(
            "COMMAND_LONG", 1, 1, number, 0, *params, *[0.0] * (7 - len(params))
        )

    def frames(self, tick):
        frames = []
        # A setpoint would end the take-off
        if self.flavour != "arducopter" or not 60 <= tick < 190:
            frames.append(
                self.encoder.pack(
                    "SET_POSITION_TARGET_LOCAL_NED",
                    tick,
                    1,
                    1,
                    1,
                    2503,
                    0,
                    0,
                    0,
                    2.0,
                    0.0,
                    -1.0,
                    0,
                    0,
                    0,
                    0.0,
                    0.0,
                )
            )
        if tick % 20 == 0:
            frames.append(self.encoder.pack("HEARTBEAT", 6, 8, 0, 0, 4, 3))
        if tick in {30, 31}:
            frames.append(
                self.command(176, *GUIDED[self.flavour]) if tick == 30 else self.command(400, 1.0)
            )
        if tick == 60 and self.flavour == "arducopter":
            frames.append(self.command(22, 0, 0, 0, 0, 0, 0, 10.0))
        return frames


def vehicle(flavour, signing=None):
    return MockVehicle(flavour, seed=3, ready_after_s=0.5, signing=signing)


def link_of(mock):
    return next(iter(mock.links.values()))


@pytest.mark.parametrize(
    ("flavour", "key"), [("px4", None), ("px4", KEY), ("arducopter", KEY), ("rover", None)]
)
def test_a_vehicle_under_fire_does_what_its_twin_does_in_peace(flavour, key):
    signing, calm_signing = (Signing(key), Signing(key)) if key else (Signing(), Signing())
    fired_at = vehicle(flavour, signing)
    twin = vehicle(flavour, calm_signing)
    client = Client(flavour, key)
    traffic = HostileTraffic(seed=11)
    sources = list((traffic.kinds_against_signing if key else traffic.kinds).values())
    sent = 0
    for tick in range(TICKS):
        good = client.frames(tick)
        bad = [sources[(sent + index) % len(sources)]() for index in range(FRAMES_PER_TICK)]
        sent += len(bad)
        mixed = bad[: FRAMES_PER_TICK // 2] + good + bad[FRAMES_PER_TICK // 2 :]
        assert fired_at.step(tick * STEP_S, mixed) == twin.step(tick * STEP_S, good)
    assert (fired_at.mode, fired_at.armed, fired_at.truth) == (twin.mode, twin.armed, twin.truth)
    assert twin.armed
    counts = link_of(fired_at).decoder.counts
    calm = link_of(twin).decoder.counts
    assert (
        min(
            counts.crc,
            counts.unknown_id,
            counts.incompatible,
            counts.truncated,
            counts.garbage_bytes,
        )
        > 0
    )
    assert counts.frames >= calm.frames
    if key:
        assert min(counts.unsigned, counts.wrong_key) > 0
        assert signing.streams == calm_signing.streams


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_valid_frames_with_random_fields_never_raise_and_heartbeats_continue(flavour):
    """Catches a handler that trusts a field of a valid frame."""
    mock = vehicle(flavour)
    client = Client(flavour)
    traffic = HostileTraffic(seed=1)
    beats = Decoder()
    heard = 0
    for tick in range(TICKS):
        own = [
            frame
            for frame in (traffic.own() for _ in range(FRAMES_PER_TICK))
            if message_id(frame) != SETUP_SIGNING
        ]
        for frame in mock.step(tick * STEP_S, client.frames(tick) + own):
            heard += sum(
                message.get_type() == "HEARTBEAT" for message in beats.feed(frame, whole=True)
            )
    assert heard >= TICKS * STEP_S - 2
    assert beats.counts.as_dict() == {
        **dict.fromkeys(beats.counts.as_dict(), 0),
        "frames": beats.counts.frames,
    }


def message_id(frame):
    return int.from_bytes(frame[7:10], "little")


def test_whatever_the_vehicle_answers_to_hostile_frames_can_be_read_by_pymavlink():
    mock = vehicle("px4")
    traffic = HostileTraffic(4)
    parser = dialect.MAVLink(None, 255, 190)
    for tick in range(60):
        own = [
            frame
            for frame in (traffic.own() for _ in range(30))
            if message_id(frame) != SETUP_SIGNING
        ]
        for frame in mock.step(tick * STEP_S, own):
            assert parser.decode(bytearray(frame)).get_srcSystem() == 1


@settings(max_examples=drawn(300), deadline=None)
@given(st.lists(st.binary(max_size=400), max_size=20), st.booleans())
def test_any_bytes_at_all_are_taken_without_an_exception_and_the_buffer_stays_small(chunks, whole):
    decoder = Decoder()
    for chunk in chunks:
        decoder.feed(chunk, whole=whole)
        assert decoder.pending < MAX_FRAME
        assert not (whole and decoder.pending)


@settings(max_examples=drawn(300), deadline=None)
@given(st.sampled_from(sorted(SPEC_BY_ID)), st.binary(min_size=255, max_size=255))
def test_any_payload_of_any_message_decodes_as_pymavlink_decodes_it(message_id, noise):
    spec = SPEC_BY_ID[message_id]
    body = bytes((spec.size, 0, 0, 1, 255, 190)) + spec.id_bytes + noise[: spec.size]
    frame = b"\xfd" + body + dialect.x25crc(body + spec.crc_extra).crc.to_bytes(2, "little")
    (ours,) = Decoder().feed(frame, whole=True)
    theirs = dialect.MAVLink(None, 1, 1).decode(bytearray(frame))
    assert str(ours) == str(theirs)


@pytest.mark.parametrize("message_id", sorted(NEWER))
def test_a_message_that_pymavlink_lacks_shows_its_fields_as_any_other(message_id):
    spec = SPEC_BY_ID[message_id]
    payload = bytes(range(1, spec.size + 1))
    values = dict(zip(spec.wire_names, spec.unpack_payload(payload), strict=True))
    frame = Encoder(1, 1).pack(spec.name, *(values[name] for name in spec.field_names))
    (ours,) = Decoder().feed(frame, whole=True)
    theirs = dialect.MAVLink(None, 1, 1).decode(bytearray(frame))
    assert ours.to_dict() == theirs.to_dict()
    assert set(ours.to_dict()) == {"mavpackettype", *spec.field_names}


def test_the_same_seed_fires_the_same_frames():
    first = HostileTraffic(9)
    second = HostileTraffic(9)
    for kind, source in first.kinds_against_signing.items():
        assert source() == second.kinds_against_signing[kind]()


def refused(parser, frame):
    try:
        return isinstance(parser.decode(bytearray(frame)), dialect.MAVLink_unknown)
    except dialect.MAVError:
        return True


def test_each_kind_of_hostile_frame_is_what_it_says():
    traffic = HostileTraffic(8)
    parser = dialect.MAVLink(None, 1, 1)
    ids = {target.spec.message_id: target for target in TARGETS}
    for _ in range(300):
        foreign = parser.decode(bytearray(traffic.foreign()))
        target = ids[foreign.get_msgId()]
        elsewhere = foreign.target_system not in {0, 1}
        assert elsewhere or (
            target.component_at is not None and foreign.target_component not in {0, 1}
        )
        assert isinstance(parser.decode(bytearray(traffic.unknown())), dialect.MAVLink_unknown)
        assert traffic.incompatible()[2] & ~1
        assert refused(parser, traffic.corrupted())
    parser.signing.secret_key = WRONG_KEY
    assert parser.decode(bytearray(traffic.wrong_key())).get_signed()
