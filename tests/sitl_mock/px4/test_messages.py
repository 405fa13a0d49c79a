"""PX4's messages on the wire, against ROS 2's own rules as `rosbags` implements them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from sitl_mock.px4.messages import HEAD, PADDING, message_type, names


def _typestore() -> Typestore:
    store = Typestore()
    for name in names():
        text = "\n".join(
            f"{field.kind}{f'[{field.length}]' if field.length else ''} {field.name}"
            for field in message_type(name).fields
        )
        store.register(get_types_from_msg(text, f"px4_msgs/msg/{name}"))
    return store


STORE = _typestore()


@pytest.mark.parametrize("name", names())
def test_a_type_has_the_hash_that_ros_computes(name):
    assert message_type(name).hash == STORE.hash_rihs01(f"px4_msgs/msg/{name}")


def flat(message) -> list:
    """Every value of a record of `rosbags`, arrays and nested messages flattened."""
    values = []
    for name, value in vars(message).items():
        if name == "__msgtype__":
            continue
        for element in value if hasattr(value, "__len__") else [value]:
            values += flat(element) if hasattr(element, "__msgtype__") else [element]
    return values


@pytest.mark.parametrize("name", names())
@given(seed=st.binary(min_size=16, max_size=64))
def test_a_payload_reads_as_ros_reads_it_and_comes_back(name, seed):
    kind = message_type(name)
    body = (seed * (kind.size // len(seed) + 1))[: kind.size]
    mine = kind.read(HEAD + body)
    theirs = STORE.deserialize_cdr(HEAD + body, f"px4_msgs/msg/{name}")
    values = [bool(value) if isinstance(value, bool) else value for value in flat(theirs)]
    encoded = kind.encode([float(v) if isinstance(v, float) else v for v in values])
    assert len(encoded) == kind.memory_bytes + len(HEAD) + PADDING
    again = kind.read(encoded)
    assert str(again) == str(mine)  # as text, so that NaN equals NaN


def test_a_payload_for_px4_may_not_be_longer_than_the_message_in_its_memory():
    kind = message_type("TrajectorySetpoint")
    assert (kind.size, kind.memory_bytes) == (64, 64)
    whole = kind.encoded(velocity=(1.0, 2.0, 3.0), yaw=math.nan)
    assert kind.decode(whole) is None
    assert kind.decode(whole[: 4 + 64]).velocity == (1.0, 2.0, 3.0)
    assert kind.decode(whole[: 4 + 63]) is None


def test_the_log_has_the_largest_types_first():
    kind = message_type("VehicleStatus")
    assert kind.log_format.startswith(
        "uint64_t timestamp;uint64_t armed_time;uint64_t takeoff_time;"
    )
    values = list(range(len(kind.fields)))
    assert kind.from_log_order(values)[0] == 0
    by_log = {field.name: index for index, field in enumerate(kind.in_log_order)}
    on_wire = kind.from_log_order(values)
    assert [on_wire[index] for index, _ in enumerate(kind.fields)] == [
        by_log[field.name] for field in kind.fields
    ]
