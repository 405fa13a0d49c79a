"""Two senders that report as the vehicle: their positions contradict each other, and the vehicle holds."""

import pytest

from guidance.flight import Event, Inputs, State
from guidance.frames import Ned
from guidance.messages import LocalPosition, Timesync
from guidance.session.orders.answers import failed_checks, refusal
from tests.flight.flown import Flown


class Doubled(Flown):
    """A vehicle whose positions, stamped `ahead_s` ahead and `away_m` to the east, come from a second sender too."""

    away_m = 0.0
    ahead_s = 0.3

    def inputs(self, said, *rest):
        forged = [
            message._replace(
                time_boot_s=message.time_boot_s + self.ahead_s,
                position_ned_m=Ned((0.0, self.away_m, message.position_ned_m[2])),
            )
            for message in said
            if isinstance(message, LocalPosition) and self.away_m
        ]
        return super().inputs([*said, *forged], *rest)


@pytest.mark.parametrize("ahead_s", [0.3, 0.1, 0.01])
def test_positions_that_jump_between_two_senders_end_the_game(ahead_s):
    doubled = Doubled().engaged()
    doubled.ahead_s = ahead_s
    doubled.away_m = 5.0
    doubled.cycles(ahead_s + 0.2)
    assert doubled.state is State.HOLDING
    assert doubled.flight.cause.event is Event.SECOND_SENDER


@pytest.mark.parametrize("ahead_s", [0.2, 0.9, 5.0])
def test_stamps_of_two_clocks_end_the_game_however_small_the_step_is(ahead_s):
    doubled = Doubled().engaged()
    doubled.ahead_s = ahead_s
    doubled.away_m = 0.2
    doubled.cycles(1.5)
    assert doubled.state is State.HOLDING
    assert doubled.flight.cause.event is Event.SECOND_SENDER
    assert doubled.flight.vehicle.reboots == 0


def test_a_simulator_that_catches_up_after_a_pause_is_no_second_sender():
    flown = Flown().engaged()
    flown.cycles(2.0)
    pause_s = 0.8

    def inputs(said, *rest):
        stamped = [
            message._replace(time_boot_s=message.time_boot_s - pause_s)
            if isinstance(message, LocalPosition)
            else message._replace(remote_ns=message.remote_ns - round(pause_s * 1e9))
            if isinstance(message, Timesync)
            else message
            for message in said
        ]
        return Inputs(stamped, *rest)

    flown.inputs = inputs
    while pause_s > 0.0:
        pause_s -= 0.04
        flown.cycle(beat=True)
        assert not flown.flight.vehicle.contradicted_s


def test_they_keep_the_vehicle_on_the_ground_and_bar_an_engagement():
    doubled = Doubled()
    doubled.away_m = 5.0
    doubled.cycles(1.0)
    assert doubled.state is State.CHECKING
    assert "sender (positions of two senders)" in failed_checks(doubled.flight, doubled.now_s)
    doubled = Doubled().standing_by()
    doubled.away_m = 5.0
    doubled.cycles(1.0)
    doubled.cycle(Event.ENGAGE)
    assert doubled.state is State.STANDING_BY
    answer = refusal(Event.ENGAGE, doubled.flight, doubled.now_s, ())
    assert answer.startswith("two senders report as the vehicle")


def test_reordered_positions_and_one_jump_of_the_estimate_are_no_second_sender():
    flown = Flown().engaged()
    flown.velocity = [3.0, 0.0, 0.0]
    resets = flown.flight.vehicle.resets
    sent = []
    for number in range(200):
        flown.position[0] += 3.0 * 0.02
        flown.position[1] = 4.0 if number > 100 else 0.0
        now_s = flown.now_s + 0.02
        sent.append(LocalPosition(now_s, now_s, Ned(tuple(flown.position)), Ned((3.0, 0.0, 0.0))))
        late = [sent[-10]._replace(received_s=now_s)] if number > 10 else []
        flown.cycle(more=late)
        assert not flown.flight.vehicle.contradicted_s
    assert flown.flight.vehicle.resets == resets + 1
