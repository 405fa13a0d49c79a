"""Guidance as a flight mode of PX4: what its arming check says, and what the pilot's switch orders."""

import pytest

from guidance.autopilots import PX4, Mode
from guidance.flight import Event, State
from guidance.links.px4.mode import Check, Readiness
from guidance.log.sink import Report
from guidance.session.observe.flight_mode import PILOT, FlightModeOutput
from guidance.session.orders.mailbox import Mailbox
from guidance.session.orders.words import STATUS
from tests.flight.flown import Flown
from tests.flight.scenes import settings_of


class KeptReadiness:
    """A link that keeps what it is told."""

    def __init__(self) -> None:
        self.told: list[Readiness] = []

    def tell(self, readiness: Readiness) -> None:
        self.told.append(readiness)


class Piloted(Flown):
    """A flight with the output, and the daemon's part of orders: it gives them to the flight and answers."""

    def __init__(self, **changes) -> None:
        super().__init__(settings_of(PX4.as_mode, **changes))
        self.link = KeptReadiness()
        self.mailbox = Mailbox()
        self.output = FlightModeOutput(self.link, self.mailbox)
        self.ordered: list[str] = []
        self.refused_rows: tuple[str, ...] = ()
        self.refuses: set[str] = set()

    def cycle(self, *orders, **given):
        questions, queries = self.mailbox.take()
        for query in queries:
            assert query.order == STATUS
            query.set_result({"preflight_refused": list(self.refused_rows)})
        given.setdefault("refusals", self.refused_rows)
        obeyed = [one for one in questions if one.order not in self.refuses]
        outputs = super().cycle(*orders, *(Event(one.order) for one in obeyed), **given)
        for question in questions:
            assert question.by == PILOT
            self.ordered.append(question.order)
            done = question in obeyed and self._was_followed(question.order, outputs)
            question.set_result({"accepted": done})
        self.output.report(Report(self.now_s, self.flight, outputs, None, (), None))
        return outputs

    def _was_followed(self, order, outputs) -> bool:
        return any(
            one.event in {order, Event.ALOFT} and one.after is not one.before
            for one in outputs.transitions
        )

    @property
    def checks(self):
        return tuple(self.link.told[-1].checks)

    def ready(self):
        self.cycles(1.2)
        assert self.state is State.READY
        return self

    def aloft(self):
        """Flown by a pilot, in a mode of the pilot's."""
        self.ready()
        self.armed = True
        self.landed = 2
        self.mode = Mode.OTHER
        self.position[2] -= 12.0
        self.cycle(beat=True)
        assert self.state is State.READY
        return self

    def chosen(self):
        """The pilot chooses the mode; PX4 shows it at once."""
        self.mode = Mode.GUIDED
        self.cycle(beat=True)
        for _ in range(4):
            self.cycle(beat=True)
        return self


def test_a_vehicle_that_is_ready_may_be_armed_in_the_mode():
    assert Piloted().ready().checks == ()


def test_readiness_carries_the_time_of_its_cycle():
    flown = Piloted().ready()
    assert flown.link.told[-1].judged_s == flown.now_s


def test_before_anything_is_known_it_is_not_ready():
    flown = Piloted()
    flown.cycle(silent=True)
    assert Check.POSITION in flown.checks
    assert Check.HOME in flown.checks


@pytest.mark.parametrize(
    ("rows", "check"),
    [(("COM_LOW_BAT_ACT",), Check.SETUP), (("GF_ACTION",), Check.FENCE)],
)
def test_what_preflight_refuses_bars_the_mode(rows, check):
    flown = Piloted()
    flown.refused_rows = rows
    flown.cycles(1.2)
    assert flown.checks == (check,)


def test_a_silent_evader_bars_the_mode():
    flown = Piloted().ready()
    flown.evader = None
    flown.cycles(2.0)
    assert flown.checks == (Check.EVADER,)


def test_choosing_the_mode_in_the_air_starts_and_engages():
    flown = Piloted().aloft().chosen()
    assert flown.ordered == [Event.START, Event.ENGAGE]
    assert flown.state is State.ENGAGED
    assert flown.outputs.setpoint is not None


def test_from_the_first_cycle_after_the_start_there_is_a_hover():
    flown = Piloted().aloft()
    flown.mode = Mode.GUIDED
    flown.cycle(beat=True)  # the choice is seen, and start is ordered
    outputs = flown.cycle()
    assert flown.state is State.STANDING_BY
    assert outputs.setpoint is not None


def test_choosing_the_mode_while_standing_by_engages():
    flown = Piloted().standing_by()
    flown.ordered.clear()
    flown.chosen()
    assert flown.ordered == [Event.ENGAGE]
    assert flown.state is State.ENGAGED


def test_leaving_the_mode_is_a_pilots_and_final():
    flown = Piloted().aloft().chosen()
    flown.mode = Mode.OTHER
    flown.cycle(beat=True)
    assert flown.state is State.YIELDED
    assert flown.outputs.setpoint is None
    assert flown.checks == (Check.BUSY,)
    flown.chosen()
    assert flown.state is State.YIELDED
    assert flown.ordered == [Event.START, Event.ENGAGE]


def test_a_choice_that_is_refused_ends_in_hold():
    flown = Piloted().aloft()
    flown.refuses = {Event.ENGAGE}
    flown.chosen()
    flown.cycles(0.1)
    assert flown.ordered == [Event.START, Event.ENGAGE, Event.HOLD]
    assert flown.state is State.HOLDING


def test_our_own_request_for_the_mode_is_no_choice_of_the_pilot():
    flown = Piloted().engaged()
    assert flown.ordered == []
    flown.cycle(Event.HOLD)
    flown.cycles(0.2)  # HEARTBEAT still shows the mode
    assert flown.ordered == []
    assert flown.state is State.HOLDING


def test_after_a_hold_the_pilot_may_choose_the_mode_again():
    flown = Piloted().engaged()
    flown.cycle(Event.HOLD)
    flown.mode = Mode.HOLD
    flown.cycle(beat=True)
    flown.chosen()
    assert flown.ordered == [Event.ENGAGE]
    assert flown.state is State.ENGAGED


def test_arming_in_the_mode_on_the_ground_starts():
    flown = Piloted()
    flown.mode = Mode.GUIDED
    flown.ready()
    flown.armed = True
    flown.cycle(beat=True)
    flown.cycle(beat=True)
    assert flown.ordered == [Event.START]
    assert flown.state in {State.ARMING, State.CLIMBING}


def test_the_mode_is_barred_on_the_way_up_and_chosen_nevertheless_it_is_a_pilots():
    flown = Piloted().ready()
    flown.cycle(Event.START)
    flown.armed_as_asked()
    flown.cycle(beat=True)
    assert flown.checks == ()  # taking off is no reason to leave the mode
    flown.mode = Mode.TAKEOFF
    flown.landed = 2
    flown.cycle(beat=True)
    assert flown.state is State.CLIMBING
    assert flown.checks == (Check.BUSY,)
    flown.chosen()
    assert flown.ordered == []
    assert flown.state is State.YIELDED


def test_while_guidance_flies_the_mode_stays_allowed():
    flown = Piloted().engaged()
    flown.evader = None
    for _ in range(100):
        flown.cycle()
        assert flown.checks == ()
    assert flown.state is State.PAUSED
    flown.cycle(Event.RETURN)
    assert flown.state is State.RETURNING
    assert flown.checks == ()  # the mode is left by our order, not by PX4's failsafe
    flown.mode = Mode.RETURN
    flown.cycle(beat=True)
    assert flown.checks == (Check.BUSY,)
