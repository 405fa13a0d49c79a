"""PX4's messages, compared with `rosbags`, which computes hashes and lays out bytes by itself."""

import math
import random

import pytest

from guidance.links.px4.messages import FROM_PX4, TO_PX4, TYPES, name_bytes
from tests.links.px4.peer import STORE, encoded, text


@pytest.mark.parametrize("name", TYPES)
def test_a_hash_is_that_of_the_fields(name):
    assert TYPES[name].hash == STORE.hash_rihs01(f"px4_msgs/msg/{name}")


def numbers_of(name: str, prefix: str = "") -> list[tuple[str, str]]:
    """Return the name and type of every number of a message; an array of bytes is one."""
    found = []
    for field in TYPES[name].fields.split(", "):
        kind, key = field.split(" ")
        base, _, count = kind.rstrip("]").partition("[")
        if base in TYPES:
            for index in range(int(count)):
                found += numbers_of(base, f"{prefix}{key}_{index}_")
        elif base == "uint8" and count:
            found.append((prefix + key, kind))
        elif count:
            found += [(f"{prefix}{key}_{index}", base) for index in range(int(count))]
        else:
            found.append((prefix + key, base))
    return found


def some(kind: str, draw: random.Random):
    if kind.startswith("uint8["):
        return draw.randbytes(int(kind[6:-1]))
    if kind == "bool":
        return draw.random() < 0.5
    if kind.startswith("float"):
        return draw.randrange(-1000, 1000) / 8
    bits = int(kind.strip("uint"))
    return draw.getrandbits(bits - 1)


@pytest.mark.parametrize("name", TYPES)
def test_every_field_is_where_rosbags_reads_and_writes_it(name):
    draw = random.Random(name)
    values = {key: some(kind, draw) for key, kind in numbers_of(name)}
    ours = TYPES[name].encode(**values)
    theirs = STORE.deserialize_cdr(ours, f"px4_msgs/msg/{name}")
    again = bytes(STORE.serialize_cdr(theirs, f"px4_msgs/msg/{name}", little_endian=True))
    assert again == ours
    assert TYPES[name].decode(again)._asdict() == pytest.approx(values)


@pytest.mark.parametrize("name", FROM_PX4.values())
def test_padding_is_accepted_and_more_or_less_is_not(name):
    kind = TYPES[name]
    data = encoded(name)
    assert kind.decode(data) == kind.decode(kind.encode())
    for wrong in (data + b"\0", kind.encode()[:-1], b"", b"\0\1"):
        with pytest.raises(ValueError, match=f"{name}: .* bytes, not "):
            kind.decode(wrong)


@pytest.mark.parametrize("name", TO_PX4.values())
def test_what_is_sent_fits_into_px4s_own_structure(name):
    assert len(TYPES[name].encode()) <= TYPES[name].most_bytes - 24


def test_another_byte_order_is_not_read():
    data = b"\0\0" + TYPES["ModeCompleted"].encode()[2:]
    with pytest.raises(ValueError, match="encapsulation"):
        TYPES["ModeCompleted"].decode(data)


def test_nan_stays_nan_and_what_does_not_fit_is_refused():
    sent = TYPES["TrajectorySetpoint"].encode(yaw=math.nan)
    assert math.isnan(TYPES["TrajectorySetpoint"].decode(sent).yaw)
    with pytest.raises(ValueError, match="ModeCompleted: "):
        TYPES["ModeCompleted"].encode(nav_state=300)


def test_a_key_is_that_of_rmw_zenoh():
    assert TYPES["ModeCompleted"].key(7, "fmu/in/mode_completed") == (
        "7/fmu/in/mode_completed/px4_msgs::msg::dds_::ModeCompleted_/"
        "RIHS01_9b2bbfcc9a544dd64c8e534a342c6b4567c8486c376e724453d0f4b86f3ee21d"
    )


@pytest.mark.parametrize("name", ["", "x" * 25, "Verfolgung übt", "two\nlines"])
def test_a_name_that_px4_cannot_keep_is_refused(name):
    with pytest.raises(ValueError, match="1 to 24 printable ASCII characters"):
        name_bytes(name)


def test_a_name_is_25_bytes():
    assert list(name_bytes("Pursuit")) == text("Pursuit")
