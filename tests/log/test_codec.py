import json
import math
from typing import NamedTuple, get_args, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.errors import ConfigError
from guidance.flight import Event, Inputs, Outputs, State
from guidance.frames import Ned
from guidance.log.codec import Codec
from guidance.log.entries import CYCLE, cycle_entry
from guidance.messages import (
    AltitudeSaid,
    Attitude,
    Datum,
    EvaderReport,
    MateState,
    Message,
    Role,
    Setpoint,
    StatusText,
    Timesync,
)

finite = st.floats(allow_nan=False, allow_infinity=False)
VALUES = {
    float: finite | st.just(math.nan),
    int: st.integers(-(2**63), 2**63),
    bool: st.booleans(),
    str: st.text(max_size=30),
    Ned: st.tuples(finite, finite, finite | st.just(math.nan)).map(Ned),
}


def of_kind(kind):
    return st.builds(kind, **{name: VALUES[hint] for name, hint in get_type_hints(kind).items()})


VALUES[int | None] = st.none() | VALUES[int]
VALUES[str | None] = st.none() | VALUES[str]
VALUES[Datum] = st.sampled_from(Datum)
VALUES[Timesync | None] = st.none() | of_kind(Timesync)
VALUES[AltitudeSaid | None] = st.none() | of_kind(AltitudeSaid)

inputs = st.builds(
    Inputs,
    messages=st.lists(st.one_of([of_kind(kind) for kind in get_args(Message)]), max_size=6).map(
        tuple
    ),
    reports=st.lists(of_kind(EvaderReport), max_size=3).map(tuple),
    orders=st.lists(st.sampled_from(Event), max_size=3).map(tuple),
    refusals=st.lists(st.text(max_size=10), max_size=3).map(tuple),
    mission=st.lists(st.sampled_from(Event), max_size=2).map(tuple),
    mates=st.none() | st.lists(of_kind(MateState), max_size=2).map(tuple),
    role=st.none()
    | st.builds(Role, evader=VALUES[str], above_m=finite),  # a role's message has no other heights
    answer=st.none() | st.lists(VALUES[float], max_size=3).map(tuple),
)


def read(kind, value):
    return Codec(kind.__name__, kind).decode(json.dumps(value))


@given(inputs)
def test_any_inputs_come_back_bit_for_bit_with_their_types(given_inputs):
    """Catches a value or a type that a record loses."""
    entry = cycle_entry(0.5, given_inputs, Outputs(State.READY, None, (), (), None))
    back = CYCLE.decode(CYCLE.encode(entry)).inputs
    assert repr(back) == repr(given_inputs)  # repr tells NaN, -0.0, 1 and 1.0 apart
    assert [type(message) for message in back.messages] == [
        type(message) for message in given_inputs.messages
    ]


def test_text_with_a_lone_surrogate_does_not_end_the_record():
    entry = cycle_entry(
        1.0,
        Inputs((StatusText(1.0, 2, "low \ud800 battery"), Attitude(1.0, math.nan, 0.5))),
        Outputs(State.READY, None, (), (), None),
    )
    text, attitude = CYCLE.decode(CYCLE.encode(entry)).inputs.messages
    assert text == StatusText(1.0, 2, "low ? battery")
    assert repr(attitude) == repr(entry.inputs.messages[1])


def test_an_absent_part_of_a_setpoint_is_read_as_none_not_nan():
    setpoint = Setpoint(Ned((1.0, -0.0, 2.0)), yaw_rad=0.5)
    codec = Codec("setpoint", Setpoint)
    assert repr(codec.decode(codec.encode(setpoint))) == repr(setpoint)


class Later(NamedTuple):
    a: int
    b: float = 2.0
    c: float | None = None


def test_a_field_with_a_default_may_be_missing_in_an_older_record():
    assert read(Later, {"a": 1}) == Later(1, 2.0)
    assert read(Later, {"a": 1, "c": None}) == Later(1, 2.0)
    with pytest.raises(ConfigError, match=r"Later\.a: is missing"):
        read(Later, {"b": 1.0})


def test_an_absent_or_null_number_is_read_as_nan_never_zero():
    for said in ({}, {"amount": None}):
        assert math.isnan(read(Amount, said).amount)


class Amount(NamedTuple):
    amount: float


class Old(NamedTuple):
    a: float
    state: State


@pytest.mark.parametrize(
    ("value", "what"),
    [
        ({"a": 1.0}, "Old.state: is missing"),
        ({"a": 1.0, "state": "ready", "b": 2}, "Old.b = 2: is unknown to this version"),
        ({"a": "1", "state": "ready"}, "Old.a = '1': must be a number"),
        ({"a": True, "state": "ready"}, "Old.a = True: must be a number"),
        ({"a": 1.0, "state": "flying"}, "Old.state = 'flying': .*'engaged'"),
        (3, "Old = 3: "),
    ],
)
def test_a_row_of_another_version_is_refused_with_the_field_that_differs(value, what):
    with pytest.raises(ConfigError, match=what):
        read(Old, value)


def test_an_unknown_message_kind_is_named():
    with pytest.raises(ConfigError, match=r"'Wind'.*Attitude"):
        read(Inputs, {"messages": [{"kind": "Wind"}], "reports": [], "orders": []})
