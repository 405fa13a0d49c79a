"""The loop's own silence is judged by the autopilot's wait for setpoints, as its parameter says."""

from functools import cache

import pytest

from guidance.flight import Event, State
from guidance.flight.detection import LOSS_SPARE_S
from guidance.messages import Parameter
from tests.flight.flown import Flown
from tests.flight.scenes import ARDUCOPTER, PX4, settings_of
from tests.harness.sortie import Sorties, Stepped

PARAMETERS = {"px4": "COM_OF_LOSS_T", "arducopter": "GUID_TIMEOUT"}
DEFAULTS = {"px4": 1.0, "arducopter": 3.0}


@pytest.fixture(scope="module")
def sorties(soon_up_and_down):
    made = Sorties(Stepped)
    yield made
    made.close()


@cache
def engaged(wait_s):
    """Return a function that flies a sortie into the game; its autopilot waits so long for setpoints."""

    def fly(sortie):
        name = PARAMETERS[sortie.scenario.pursuer.autopilot]
        sortie.mock.autopilot.parameters.set(name, wait_s)
        return sortie.engaged().run(3.0)

    return fly


def stopped(sorties, autopilot, wait_s, stop_s, *, in_one_step=False):
    """An engaged sortie whose loop stands still for a while; in one step, if its world is not stepped meanwhile."""
    sortie = sorties.after(engaged(wait_s), autopilot)
    if in_one_step:
        sortie.clock.sleep_until(sortie.now_s + stop_s)
    sortie.frozen = not in_one_step
    sortie.run(0.0 if in_one_step else stop_s)
    sortie.frozen = False
    return sortie


@pytest.mark.flight
@pytest.mark.parametrize("in_one_step", [False, True])
@pytest.mark.parametrize(
    ("autopilot", "wait_s", "stop_s"),
    [
        ("px4", 0.3, 0.5),
        ("px4", 0.3, 0.9),
        ("px4", 1.0, 1.2),
        ("arducopter", 1.0, 1.2),
        ("arducopter", 1.0, 2.5),
    ],
)
def test_after_its_wait_guidance_has_yielded_and_never_streams_again(
    sorties, autopilot, wait_s, stop_s, in_one_step
):
    sortie = stopped(sorties, autopilot, wait_s, stop_s, in_one_step=in_one_step)
    observed = len(sortie.sent)
    streamed = len(sortie.setpoints)
    modes = []
    for _ in range(5):
        sortie.cycle()
        modes.append(sortie.mock.mode)
    assert sortie.state is State.YIELDED
    # A HEARTBEAT of the failsafe may have come meanwhile
    if sortie.flight.cause.event is not Event.PILOT:
        assert f"waits for setpoints for {wait_s:g} s" in sortie.flight.cause.words
    for _ in range(200):
        sortie.cycle()
        modes.append(sortie.mock.mode)
    assert len(sortie.setpoints) == streamed
    # The failsafe's mode is never left again. ArduCopter waits in GUIDED and is asked for its hold.
    assert modes == sorted(modes, key=lambda mode: mode not in {"OFFBOARD", "GUIDED"})
    assert modes[-1] not in {"OFFBOARD", "GUIDED"}
    if autopilot == "px4":
        assert modes[0] != "OFFBOARD"
        assert {sent.name for sent in sortie.sent[observed:]} <= {"HEARTBEAT", "TIMESYNC"}


@pytest.mark.flight
@pytest.mark.parametrize(
    ("autopilot", "wait_s", "stop_s"),
    [("px4", 1.0, 0.6), ("arducopter", 1.0, 0.6)],
)
def test_before_it_the_game_pauses_and_goes_on(sorties, autopilot, wait_s, stop_s):
    sortie = stopped(sorties, autopilot, wait_s, stop_s)
    sortie.run(0.1)
    assert sortie.state is State.PAUSED
    sortie.until(State.ENGAGED, limit_s=4.0)


@pytest.mark.parametrize("autopilot", [PX4, ARDUCOPTER])
def test_the_wait_is_the_parameters_as_it_was_heard_last(autopilot):
    name = PARAMETERS[autopilot.name]
    flight = Flown(settings_of(autopilot)).engaged()
    observed = flight.flight.observed
    assert observed.setpoint_timeout_s == DEFAULTS[autopilot.name]
    flight.cycle(more=[Parameter(flight.now_s, name, 0.7), Parameter(flight.now_s, "OTHER", 9.0)])
    assert observed.setpoint_timeout_s == 0.7
    flight.cycle(dt_s=0.69 - LOSS_SPARE_S)
    assert flight.state is State.PAUSED
    flight.cycle(dt_s=0.71 - LOSS_SPARE_S)
    assert flight.state is State.YIELDED


def test_a_vehicle_that_is_handed_over_is_not_streamed_to_after_its_wait_has_passed():
    flight = Flown().engaged()
    assert flight.cycle(Event.HOLD).setpoint is not None  # a hover, until HEARTBEAT shows the hold
    assert flight.cycle().setpoint is not None
    assert flight.cycle(dt_s=1.0).setpoint is None
    outputs = flight.cycles(0.5)
    assert flight.state is State.HOLDING
    assert {output.setpoint for output in outputs} == {None}
