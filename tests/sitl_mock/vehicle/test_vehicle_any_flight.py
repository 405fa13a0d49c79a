"""Invariants of a vehicle under random clients, pilots and conditions, as a property of random flights."""

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sitl_mock.flavours import NAMES, flavour_named
from sitl_mock.mavlink import Decoder
from sitl_mock.vehicle.conditions import CONDITIONS
from tests.harness.examples import drawn

NUMBER = st.one_of(
    st.sampled_from([0.0, 1.0, 2.0, 6.0, -1.0, math.nan, math.inf, 21196.0, 1e9]),
    st.floats(-200, 200),
)
COMMANDS = st.tuples(
    st.just("command"),
    st.sampled_from(
        [20, 21, 22, 176, 178, 179, 185, 192, 193, 224, 241, 246, 300, 400, 401, 511, 512]
    ),
    st.lists(NUMBER, min_size=7, max_size=7),
)
ARM = st.just(("command", 400, [1.0, 0, 0, 0, 0, 0, 0]))
MODES = st.tuples(st.just("mode"), st.integers(0, 40))
STREAMS = st.tuples(
    st.just("stream"),
    st.sampled_from([0, 1, 7, 8, 9, 12]),
    st.one_of(st.sampled_from([2503, 3555, 3079, 0x0DF8, 0x0FFF]), st.integers(0, 4095)),
    st.lists(st.one_of(st.floats(-20, 20, width=32), st.just(math.nan)), min_size=11, max_size=11),
)
VALUES = {
    "sticks": st.tuples(*[st.floats(-1, 1)] * 4),
    "rc": st.booleans(),
    "ekf_jump_m": st.tuples(*[st.floats(-20, 20)] * 3),
    "ekf_yaw_jump_deg": st.floats(-180, 180),
    "eph_m": st.floats(0, 100),
    "drift_m_s": st.tuples(*[st.floats(-2, 2)] * 3),
    "thrust_share": st.floats(0, 1),
    "battery": st.floats(0, 1),
    "wind_m_s": st.tuples(*[st.floats(-8, 8)] * 3),
    "gust_m_s": st.floats(0, 4),
    "push_m_s": st.tuples(*[st.floats(-5, 5)] * 3),
    "time_jump_s": st.floats(-100, 5e6),
    "reboot": st.just(True),
    "arm_refused": st.sampled_from(["", "Compass"]),
    "pilot_mode": st.integers(0, 40),
}
FATE = st.sampled_from(sorted(CONDITIONS)).flatmap(
    lambda name: st.tuples(st.just("inject"), st.just(name), VALUES.get(name, st.booleans()))
)
EVENTS = st.lists(
    st.tuples(st.one_of(COMMANDS, ARM, MODES, STREAMS, FATE), st.floats(0.05, 3.0)),
    min_size=5,
    max_size=25,
)


def act(flight, modes, event):
    """Apply an event; returns the stream to continue, if the event is one."""
    if event[0] == "command":
        flight.send("COMMAND_LONG", 1, 1, event[1], 0, *event[2])
    elif event[0] == "mode":
        number = modes[event[1] % len(modes)].number
        main, sub = (number >> 16 & 0xFF, number >> 24) if flight.flavour == "px4" else (number, 0)
        flight.send("COMMAND_LONG", 1, 1, 176, 0, 1.0, main, sub, *[0.0] * 4)
    elif event[0] == "inject":
        value = modes[event[2] % len(modes)].name if event[1] == "pilot_mode" else event[2]
        flight.vehicle.inject(event[1], value)
    else:
        return ("SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, event[1], event[2], *event[3])
    return None


@pytest.mark.parametrize("name", NAMES)
@settings(
    max_examples=drawn(12),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(events=EVENTS, airborne=st.booleans())
def test_it_never_fails_stays_above_ground_and_in_its_table(fly, name, events, airborne):
    """Catches a sequence of commands and faults that no other test thought of."""
    flight = fly(name, noise=True, dt_s=0.05)
    modes = flavour_named(name).modes.modes
    flight.run(1.0)
    if airborne and name != "rover":
        flight.airborne(5.0)
    decoder = Decoder()
    for event, seconds in events:
        stream = act(flight, modes, event)
        flight.run(max(0.05, seconds), stream)
        vehicle = flight.vehicle
        body = vehicle.truth
        state = vehicle.autopilot.state
        assert vehicle.mode in vehicle.modes
        assert all(
            map(math.isfinite, (*body.position_ned_m, *body.velocity_ned_m_s, *state.attitude))
        )
        assert body.position_ned_m[2] <= vehicle.autopilot.ground_m + 1e-6
        assert all(link.unsendable == 0 for link in vehicle.links.values())
        if name != "rover" and not vehicle.armed and body.on_ground:
            assert math.hypot(*body.velocity_ned_m_s) < 0.5
    for frame in flight.frames:
        decoder.feed(frame, whole=True)
    counts = decoder.counts.as_dict()
    assert counts.pop("frames") == len(flight.frames)
    assert not any(counts.values())
