"""Signing: what pymavlink signs is accepted and the other way round; everything else is dropped and counted."""

from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import all as dialect

from sitl_mock import MockVehicle
from sitl_mock.mavlink import Decoder, Encoder, Signing, Verdict
from sitl_mock.mavlink.signing import MAX_STREAMS, NEW_STREAM_WINDOW
from sitl_mock.protocols import SigningSetup

KEY = bytes(range(32))
OTHER = bytes(32 * [7])
HEARTBEAT = (6, 8, 0, 0, 4, 3)


def client(key=KEY, timestamp=1000, link_id=3, system=255, component=190):
    mav = dialect.MAVLink(SimpleNamespace(write=lambda _: None), system, component)
    if key is not None:
        mav.signing.secret_key = key
        mav.signing.timestamp = timestamp
        mav.signing.link_id = link_id
        mav.signing.sign_outgoing = True
    return mav


def heartbeat(mav):
    return dialect.MAVLink_heartbeat_message(*HEARTBEAT).pack(mav)


def vehicle(key=KEY, *, require=True):
    return Decoder(signing=Signing(key, require=require))


def test_a_frame_signed_by_pymavlink_is_accepted_and_says_so():
    decoder = vehicle()
    (message,) = decoder.feed(heartbeat(client()))
    assert (message.get_signed(), message.get_link_id()) == (True, 3)
    assert decoder.counts.frames == 1


def test_pymavlink_accepts_what_is_signed_here():
    encoder = Encoder(1, 1, signing=Signing(KEY, timestamp=5000), link_id=9)
    receiver = client()
    receiver.signing.sign_outgoing = False
    for _ in range(3):
        message = receiver.decode(bytearray(encoder.pack("HEARTBEAT", *HEARTBEAT)))
        assert (message.get_signed(), message.get_link_id()) == (True, 9)
    assert receiver.signing.goodsig_count == 3


def test_both_make_the_same_bytes_at_the_same_time():
    encoder = Encoder(255, 190, signing=Signing(KEY, timestamp=999), link_id=3)
    assert encoder.pack("HEARTBEAT", *HEARTBEAT) == heartbeat(client(timestamp=1000))


def test_without_a_key_signed_frames_pass_unchecked():
    (message,) = vehicle(None).feed(heartbeat(client(OTHER)))
    assert not message.get_signed()
    assert Encoder(1, 1, signing=Signing()).pack("HEARTBEAT", *HEARTBEAT)[2] == 0


def test_an_unsigned_frame_is_dropped_where_signing_is_required_and_passes_where_not():
    strict = vehicle()
    lenient = vehicle(require=False)
    assert strict.feed(heartbeat(client(None))) == []
    assert strict.counts.unsigned == 1
    assert len(lenient.feed(heartbeat(client(None)))) == 1


def test_the_radio_may_always_speak_unsigned():
    radio = dialect.MAVLink_radio_status_message(1, 1, 1, 1, 1, 1, 1).pack(client(None))
    assert len(vehicle().feed(radio)) == 1


@pytest.mark.parametrize("require", [True, False])
def test_a_wrong_key_is_dropped_counted_and_leaves_no_trace(require):
    decoder = vehicle(require=require)
    assert decoder.feed(heartbeat(client(OTHER, timestamp=10**12))) == []
    assert decoder.counts.wrong_key == 1
    assert (decoder.signing.streams, decoder.signing.timestamp) == ({}, 0)
    assert len(decoder.feed(heartbeat(client()))) == 1


def test_a_changed_byte_under_a_right_crc_is_a_wrong_signature():
    frame = bytearray(heartbeat(client()))
    frame[10] ^= 1  # custom_mode
    crc = dialect.x25crc(bytes(frame[1:-15]) + bytes((50,))).crc
    frame[-15:-13] = crc.to_bytes(2, "little")
    decoder = vehicle()
    assert decoder.feed(bytes(frame)) == []
    assert decoder.counts.wrong_key == 1


def test_a_replayed_or_older_frame_is_dropped():
    decoder = vehicle()
    sender = client()
    first = heartbeat(sender)
    second = heartbeat(sender)
    assert len(decoder.feed(second)) == 1
    assert decoder.feed(second) == []
    assert decoder.feed(first) == []
    assert decoder.counts.replayed == 2
    assert len(decoder.feed(heartbeat(sender))) == 1


def test_each_stream_has_its_own_order():
    decoder = vehicle()
    for link_id, system, component in ((1, 255, 190), (2, 255, 190), (1, 254, 190), (1, 255, 191)):
        sender = client(timestamp=1000, link_id=link_id, system=system, component=component)
        assert len(decoder.feed(heartbeat(sender))) == 1
    assert len(decoder.signing.streams) == 4


def test_a_new_stream_may_start_a_minute_late_and_no_later():
    for behind, accepted in ((NEW_STREAM_WINDOW, 1), (NEW_STREAM_WINDOW + 1, 0)):
        signing = Signing(KEY, timestamp=10**8)
        decoder = Decoder(signing=signing)
        assert len(decoder.feed(heartbeat(client(timestamp=10**8 - behind)))) == accepted
        assert decoder.counts.replayed == 1 - accepted


def test_all_48_bits_of_the_timestamp_count():
    decoder = vehicle()
    assert len(decoder.feed(heartbeat(client(timestamp=2**47 + 5)))) == 1
    assert decoder.signing.timestamp == 2**47 + 5
    assert decoder.feed(heartbeat(client(timestamp=2**46))) == []


def test_the_own_clock_follows_an_accepted_frame_and_rises_by_one_with_each_sent():
    signing = Signing(KEY)
    Decoder(signing=signing).feed(heartbeat(client(timestamp=77_000)))
    assert signing.timestamp == 77_000
    encoder = Encoder(1, 1, signing=signing)
    stamps = [
        int.from_bytes(encoder.pack("HEARTBEAT", *HEARTBEAT)[-12:-6], "little") for _ in range(3)
    ]
    assert stamps == [77_001, 77_002, 77_003]


def test_wall_time_raises_the_clock_in_units_of_ten_microseconds_since_2015():
    signing = Signing(KEY)
    signing.advance_to(1_420_070_400.0 + 2.5)
    assert signing.timestamp == 250_000
    signing.advance_to(0.0)
    assert signing.timestamp == 250_000


def test_a_flood_of_streams_is_bounded_even_with_the_right_key():
    decoder = vehicle()
    for link_id in range(MAX_STREAMS + 5):
        decoder.feed(heartbeat(client(link_id=link_id)))
    assert (decoder.counts.frames, decoder.counts.too_many_streams) == (MAX_STREAMS, 5)
    assert len(decoder.signing.streams) == MAX_STREAMS


def test_links_of_one_vehicle_share_key_and_streams():
    signing = Signing(KEY)
    frame = heartbeat(client())
    assert len(Decoder(signing=signing).feed(frame)) == 1
    second = Decoder(signing=signing)
    assert second.feed(frame) == []
    assert second.counts.replayed == 1


@pytest.mark.parametrize("length", [0, 31, 33])
def test_a_key_of_another_length_is_refused(length):
    with pytest.raises(ValueError, match=f"{length} bytes; it needs exactly 32"):
        Signing(bytes(length))


def test_without_a_key_there_is_no_block_and_nothing_to_check():
    signing = Signing()
    assert signing.block(b"frame", 1) == b""
    assert (
        signing.check(b"frame", signed=True, system=1, component=1, message_id=0)
        is Verdict.UNCHECKED
    )


def test_verdicts_that_let_a_frame_pass_are_two():
    assert {verdict for verdict in Verdict if verdict.accepted} == {Verdict.GOOD, Verdict.UNCHECKED}


# -- SETUP_SIGNING -----------------------------------------------------------------------------------------------------


def test_a_ground_station_sets_the_key_and_from_then_on_only_its_frames_count(wire):
    signing = Signing()
    ground = wire(SigningSetup(signing))
    assert ground.send("SETUP_SIGNING", 1, 1, list(KEY), 4000) == []
    assert (signing.secret_key, signing.timestamp, signing.active) == (KEY, 4000, True)
    decoder = Decoder(signing=signing)
    assert decoder.feed(heartbeat(client(None))) == []
    assert len(decoder.feed(heartbeat(client(timestamp=4001)))) == 1


def test_a_timestamp_beyond_48_bits_is_held_at_the_last_one(wire):
    signing = Signing()
    wire(SigningSetup(signing)).send("SETUP_SIGNING", 1, 1, list(KEY), 2**64 - 1)
    assert signing.timestamp == 2**48 - 1
    assert Encoder(1, 1, signing=signing).pack("HEARTBEAT", *HEARTBEAT)[-12:-6] == b"\xff" * 6


def test_a_key_of_zeros_switches_signing_off(wire):
    signing = Signing(KEY)
    wire(SigningSetup(signing)).send("SETUP_SIGNING", 1, 1, [0] * 32, 0)
    assert not signing.active


def test_a_new_key_forgets_the_streams_of_the_old(wire):
    signing = Signing(KEY)
    Decoder(signing=signing).feed(heartbeat(client()))
    wire(SigningSetup(signing)).send("SETUP_SIGNING", 1, 1, list(OTHER), 0)
    assert (signing.streams, signing.timestamp) == ({}, 1000)


def test_an_untrusted_link_and_a_broadcast_cannot_set_the_key(wire):
    signing = Signing()
    wire(SigningSetup(signing, allowed=False)).send("SETUP_SIGNING", 1, 1, list(KEY), 0)
    broadcast = wire(SigningSetup(signing))
    broadcast.send("SETUP_SIGNING", 0, 0, list(KEY), 0)
    assert not signing.active
    assert broadcast.send("PING", 1, 1, 1, 1) == broadcast.wait(1.0) == []


def test_an_unsigned_setup_does_not_pass_a_required_signature():
    signing = Signing(KEY)
    frame = dialect.MAVLink_setup_signing_message(1, 1, list(OTHER), 0).pack(client(None))
    assert Decoder(signing=signing).feed(frame) == []
    assert signing.secret_key == KEY


@pytest.mark.parametrize(
    ("spec", "is_signed", "answers"),
    [
        ("px4@1.17", False, {"onboard": True, "gcs": True}),  # ignores SETUP_SIGNING
        ("px4@1.18", True, {"onboard": False, "gcs": False}),
        ("arducopter", True, {"onboard": True, "gcs": False}),  # its first link takes every frame
    ],
)
def test_each_autopilot_takes_unsigned_frames_as_the_real_one_does(spec, is_signed, answers):
    vehicle = MockVehicle(spec, ready_after_s=0.1, links=dict.fromkeys(answers, "quiet"))
    vehicle.step(
        0.0, [dialect.MAVLink_setup_signing_message(1, 1, list(KEY), 0).pack(client(None))]
    )
    ask = dialect.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)
    wrong = ask.pack(client(OTHER))
    heard = vehicle.step_links(1.5, {name: [wrong] for name in answers})
    decoders = {name: Decoder(signing=Signing(KEY, require=False)) for name in answers}
    messages = {name: decoders[name].feed(b"".join(frames)) for name, frames in heard.items()}
    assert all(message.get_signed() == is_signed for message in messages["gcs"])
    kinds = {name: [m.get_type() for m in heard_there] for name, heard_there in messages.items()}
    assert "HEARTBEAT" in kinds["gcs"]
    assert {name: "AUTOPILOT_VERSION" in names for name, names in kinds.items()} == answers
