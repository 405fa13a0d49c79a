"""What is old is unknown: on the ground the vehicle is not ready, in flight it does what the table of ages says."""

import math
from dataclasses import replace

import pytest

from guidance.flight import Event, State
from guidance.flight.freshness import (
    CHARGE_LIMIT_S,
    HEIGHT_ERROR_LIMIT_S,
    NEEDED,
    STATUS_LIMIT_S,
)
from guidance.messages import (
    Attitude,
    EstimatorStatus,
    SystemStatus,
)
from guidance.session.orders.answers import failed_checks, refusal
from tests.flight.flown import ARM, SLOW_S, Flown, commands
from tests.flight.scenes import (
    BOTH,
    CYCLE,
    ENVELOPE,
    SETTINGS,
    settings_of,
)
from tests.harness.sortie import Sorties, Stepped

AUTOPILOTS = ["px4", "arducopter"]


@pytest.fixture(scope="module")
def sorties(soon_up_and_down):
    made = Sorties(Stepped)
    yield made
    made.close()


def without_status(sortie):
    """No SYS_STATUS arrives from now on."""
    lost = {"messages": ["SYS_STATUS"], "probability": 1.0, "direction": "out", "at_s": 0.0}
    sortie.world.faulted["pursuer"].inject({"kind": "loss", **lost})
    return sortie


class Silenced(Flown):
    """A vehicle without some kinds of messages, and with a charge of the test's."""

    def __init__(self, settings=SETTINGS):
        super().__init__(settings)
        self.without = ()
        self.battery = 0.9

    def inputs(self, said, *rest):
        said = [one for one in said if not isinstance(one, self.without)]
        said = [
            one._replace(battery_remaining=self.battery) if isinstance(one, SystemStatus) else one
            for one in said
        ]
        return super().inputs(said, *rest)


@pytest.mark.flight
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_without_sys_status_the_vehicle_is_not_ready_and_no_start_is_accepted(sorties, autopilot):
    sortie = without_status(sorties.ready(autopilot))
    sortie.run(STATUS_LIMIT_S + 1.0)
    assert sortie.state is State.CHECKING
    sortie.cycle(Event.START)
    sortie.run(5.0)
    assert not sortie.mock.armed
    assert "SystemStatus" in failed_checks(sortie.flight, sortie.now_s)


@pytest.mark.flight
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_charge_that_is_no_longer_told_returns_before_a_low_one_could_go_unnoticed(
    sorties, autopilot
):
    sortie = without_status(sorties.standing_by(autopilot))
    sortie.world.faulted["pursuer"].inject({"kind": "battery_low", "at_s": 2.0})
    sortie.run(CHARGE_LIMIT_S - 1.0)
    assert sortie.state is State.STANDING_BY
    sortie.run(1.6)
    assert sortie.state is State.RETURNING
    assert sortie.flight.cause.event is Event.BATTERY_UNKNOWN
    sortie.until_mock("RTL")


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("autopilot", BOTH)
def test_a_climb_lands_when_the_charge_is_old_or_low(autopilot, told):
    flight = Silenced(settings_of(autopilot)).climbing()
    if told:
        flight.battery = 0.1
        flight.cycles(3.2, dt_s=SLOW_S)  # three reports in succession
    else:
        flight.without = (SystemStatus,)
        flight.cycles(CHARGE_LIMIT_S - 1.2, dt_s=SLOW_S)
        assert flight.state is State.CLIMBING
        flight.cycles(1.6, dt_s=SLOW_S)
    assert flight.state is State.LANDING
    cause = flight.flight.cause
    assert cause.event is (Event.BATTERY_LOW if told else Event.BATTERY_UNKNOWN)
    assert cause.before is State.CLIMBING
    # Whoever holds it nevertheless is obeyed.
    flight.cycle(Event.HOLD)
    flight.cycles(4.0, dt_s=SLOW_S)
    assert flight.state is State.HOLDING


@pytest.mark.parametrize("state", ["standing by", "engaged", "holding"])
def test_a_charge_that_becomes_unknown_returns_from_wherever_a_low_one_does(state):
    flight = Silenced()
    if state == "standing by":
        flight.standing_by()
    else:
        flight.engaged()
    if state == "holding":
        flight.cycle(Event.HOLD)
    flight.battery = math.nan  # SYS_STATUS comes, and its charge is unknown
    flight.cycles(CHARGE_LIMIT_S + 1.2, dt_s=SLOW_S)
    assert flight.state is State.RETURNING
    assert flight.flight.cause.event is Event.BATTERY_UNKNOWN
    assert "charge is not known for 10 s" in flight.flight.cause.words


def test_arming_is_not_asked_for_again_once_sys_status_is_old():
    flight = Silenced()
    flight.cycles(0.1)
    flight.cycle(Event.START)
    observed = flight.cycles(1.5)
    assert ARM in commands(observed)
    flight.without = (SystemStatus,)
    flight.cycles(STATUS_LIMIT_S + 0.2)
    assert flight.state is State.ARMING
    assert ARM not in commands(flight.cycles(5.0, dt_s=SLOW_S))


def test_a_hold_that_is_ordered_while_the_charge_is_unknown_stands():
    flight = Silenced().engaged()
    flight.without = (SystemStatus,)
    flight.cycles(CHARGE_LIMIT_S + 1.2, dt_s=SLOW_S)
    assert flight.state is State.RETURNING
    flight.cycle(Event.HOLD)
    flight.cycles(20.0, dt_s=SLOW_S)
    assert flight.state is State.HOLDING


def test_a_charge_that_was_never_known_is_not_waited_for():
    flight = Silenced()
    flight.battery = math.nan
    flight.engaged()
    flight.cycles(2.0 * CHARGE_LIMIT_S, dt_s=SLOW_S)
    assert flight.state is State.ENGAGED


@pytest.mark.parametrize(
    ("without", "name"), [(Attitude, "ATTITUDE"), (SystemStatus, "SYS_STATUS")]
)
def test_an_engagement_needs_what_it_reads_although_the_vehicle_was_ready_at_its_start(
    without, name
):
    flight = Silenced().standing_by()
    assert flight.flight.checked
    flight.without = (without,)
    flight.cycles(NEEDED[without].limit_s + 1.2, dt_s=SLOW_S)
    assert flight.cycle(Event.ENGAGE).state is State.STANDING_BY
    assert f"{name} was last heard" in refusal(Event.ENGAGE, flight.flight, flight.now_s, ())
    flight.without = ()
    flight.cycles(1.2)
    assert flight.cycle(Event.ENGAGE).state is State.ENTERING


def test_an_error_of_the_height_that_is_no_longer_told_counts_as_the_largest_allowed_for():
    settings = settings_of(cycle=replace(CYCLE, envelope=replace(ENVELOPE, floor_margin_m=1.0)))
    flight = Silenced(settings).engaged()
    margin_m = flight.flight.observed.cycle.envelope.floor_margin_m
    assert margin_m > 0.5

    def counted_m():
        return flight.flight.observed.view(flight.now_s).situation.height_sd_m

    assert counted_m() == 0.0
    flight.cycle(more=[EstimatorStatus(flight.now_s, 0.2)])
    assert counted_m() == 0.2
    flight.cycles(HEIGHT_ERROR_LIMIT_S + 0.1)
    assert counted_m() == margin_m


def test_on_the_ground_is_believed_for_two_seconds():
    flight = Flown()
    flight.cycle()
    assert flight.flight.observed.on_ground
    flight.cycles(1.9, silent=True)
    assert flight.flight.observed.on_ground
    flight.cycles(0.2, silent=True)
    assert not flight.flight.observed.on_ground
