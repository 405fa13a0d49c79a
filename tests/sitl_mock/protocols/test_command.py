"""Commands: both forms are one, answers are addressed, resends do not act twice."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl_mock.protocols import (
    PX4_BROADCAST,
    Command,
    CommandAnswer,
    CommandProtocol,
    Result,
    coordinate,
)
from sitl_mock.protocols.command import MAX_TRACKED

ARM = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Autopilot:
    """Keeps executed commands and gives prepared answers."""

    def __init__(self, *answers):
        self.answers = answers or (CommandAnswer(Result.ACCEPTED),)
        self.executed = []

    def execute(self, now_s, command):
        self.executed.append((now_s, command))
        return self.answers


def long(wire, number=400, params=ARM, confirmation=0, target=(1, 1)):
    return wire.send("COMMAND_LONG", *target, number, confirmation, *params)


def results(acks):
    return [ack.result for ack in acks]


def test_an_acknowledgement_goes_to_the_one_who_asked(wire):
    pilot = Autopilot(CommandAnswer(Result.ACCEPTED, progress=3, result_param2=-7))
    asker = wire(CommandProtocol(1, 1, pilot.execute), client=(42, 191))
    (ack,) = long(asker)
    assert ack.get_type() == "COMMAND_ACK"
    assert (ack.command, ack.result, ack.progress, ack.result_param2) == (400, 0, 3, -7)
    assert (ack.target_system, ack.target_component) == (42, 191)
    assert pilot.executed[0][1] == Command(400, ARM, 0, False, (42, 191), 0)


def test_a_command_is_the_same_as_long_and_as_int(wire):
    pilot = Autopilot()
    client = wire(CommandProtocol(1, 1, pilot.execute))
    client.send("COMMAND_LONG", 1, 1, 192, 0, -1.0, 1.0, 0.0, 0.5, 47.0, 8.0, 500.0)
    client.send("COMMAND_INT", 1, 1, 0, 192, 0, 0, -1.0, 1.0, 0.0, 0.5, 470000000, 80000000, 500.0)
    (_, as_long), (_, as_int) = pilot.executed
    assert as_long.params == as_int.params == (-1.0, 1.0, 0.0, 0.5, 47.0, 8.0, 500.0)
    assert (as_long.number, as_long.frame) == (as_int.number, as_int.frame) == (192, 0)
    assert (as_long.is_int, as_int.is_int) == (False, True)


def test_the_integer_form_keeps_what_is_not_given_and_scales_by_frame():
    assert math.isnan(coordinate(2**31 - 1, 0))
    assert coordinate(-1_234_567_890, 6) == pytest.approx(-123.456789)
    assert coordinate(25_000, 1) == pytest.approx(2.5)
    assert coordinate(7, 2) == 7.0


@given(st.floats(-180.0, 180.0))
def test_degrees_survive_the_integer_form_to_a_hundred_millionth(degrees):
    assert coordinate(round(degrees * 1e7), 0) == pytest.approx(degrees, abs=5.1e-8)


def test_a_mode_change_of_px4_is_answered_twice_in_order(wire):
    answers = (CommandAnswer(Result.ACCEPTED), CommandAnswer(Result.TEMPORARILY_REJECTED))
    client = wire(CommandProtocol(1, 1, Autopilot(*answers).execute))
    assert results(long(client, 176)) == [0, 1]


def test_late_answers_come_at_their_time(wire):
    answers = (
        CommandAnswer(Result.IN_PROGRESS, progress=10),
        CommandAnswer(Result.ACCEPTED, delay_s=3.2),
    )
    client = wire(CommandProtocol(1, 1, Autopilot(*answers).execute))
    assert results(long(client)) == [5]
    assert client.wait(3.1) == []
    assert results(client.wait(0.2)) == [0]
    assert client.wait(5.0) == []


def test_a_resend_while_the_answer_is_pending_is_not_executed_again(wire):
    pilot = Autopilot(
        CommandAnswer(Result.IN_PROGRESS), CommandAnswer(Result.ACCEPTED, delay_s=1.0)
    )
    client = wire(CommandProtocol(1, 1, pilot.execute))
    long(client)
    client.wait(0.5)
    assert results(long(client)) == [5]
    assert len(pilot.executed) == 1
    assert results(client.wait(0.6)) == [0]
    assert len(pilot.executed) == 1


def test_a_counted_resend_repeats_the_answer_and_is_not_executed_again(wire):
    pilot = Autopilot(CommandAnswer(Result.ACCEPTED), CommandAnswer(Result.DENIED))
    client = wire(CommandProtocol(1, 1, pilot.execute))
    client.now_s = 100.0
    long(client)
    assert pilot.executed[0][0] == 100.0
    for confirmation in (1, 2, 3):
        client.wait(0.5)
        assert results(long(client, confirmation=confirmation)) == [2]
    assert len(pilot.executed) == 1
    client.wait(3.0)
    long(client, confirmation=4)
    assert len(pilot.executed) == 2


def test_the_same_command_again_after_its_answer_is_a_new_command(wire):
    pilot = Autopilot(CommandAnswer(Result.TEMPORARILY_REJECTED))
    client = wire(CommandProtocol(1, 1, pilot.execute))
    for _ in range(3):
        assert results(long(client)) == [1]
    assert len(pilot.executed) == 3


def test_other_parameters_are_another_command_even_with_a_counter(wire):
    pilot = Autopilot()
    client = wire(CommandProtocol(1, 1, pilot.execute))
    long(client)
    long(client, params=(0.0, *ARM[1:]), confirmation=1)
    assert [command.params[0] for _, command in pilot.executed] == [1.0, 0.0]


def test_not_a_number_equals_itself_in_a_resend(wire):
    pilot = Autopilot()
    client = wire(CommandProtocol(1, 1, pilot.execute))
    takeoff = (math.nan,) * 7
    long(client, 22, takeoff)
    long(client, 22, takeoff, confirmation=1)
    assert len(pilot.executed) == 1


def test_a_number_is_no_resend_of_not_a_number(wire):
    pilot = Autopilot()
    client = wire(CommandProtocol(1, 1, pilot.execute))
    long(client, 22, (math.nan,) * 7)
    long(client, 22, (math.nan,) * 6 + (5.0,), confirmation=1)
    assert len(pilot.executed) == 2


def test_late_answers_to_several_commands_come_together(wire):
    client = wire(
        CommandProtocol(1, 1, Autopilot(CommandAnswer(Result.ACCEPTED, delay_s=0.5)).execute)
    )
    long(client, 400)
    long(client, 22)
    assert [ack.command for ack in client.wait(1.0)] == [400, 22]


def test_no_answer_stays_no_answer(wire):
    client = wire(CommandProtocol(1, 1, lambda now_s, command: ()))
    assert long(client) == []
    assert client.wait(10.0) == []


@pytest.mark.parametrize("target", [(2, 1), (1, 100), (2, 0), (0, 190)])
def test_a_command_for_another_is_ignored(wire, target):
    pilot = Autopilot()
    assert long(wire(CommandProtocol(1, 1, pilot.execute)), target=target) == []
    assert pilot.executed == []


@pytest.mark.parametrize("target", [(1, 1), (1, 0), (0, 0), (0, 1)])
def test_own_and_broadcast_addresses_are_obeyed_by_ardupilot(wire, target):
    pilot = Autopilot()
    assert results(long(wire(CommandProtocol(1, 1, pilot.execute)), target=target)) == [0]


def test_px4_obeys_only_requests_when_they_are_broadcast(wire):
    pilot = Autopilot()
    client = wire(CommandProtocol(1, 1, pilot.execute, broadcast=PX4_BROADCAST))
    assert long(client, target=(0, 0)) == []
    assert results(long(client, 512, target=(0, 0))) == [0]
    assert [command.number for _, command in pilot.executed] == [512]


def test_what_claims_to_come_from_the_vehicle_itself_is_ignored(wire):
    pilot = Autopilot()
    assert long(wire(CommandProtocol(1, 1, pilot.execute), client=(1, 1))) == []
    assert pilot.executed == []


def test_another_message_is_no_command(wire):
    client = wire(CommandProtocol(1, 1, Autopilot().execute))
    assert client.send("PING", 1, 1, 0, 0) == []


def test_a_flood_of_numbers_does_not_grow_the_table(wire):
    pilot = Autopilot()
    protocol = CommandProtocol(1, 1, pilot.execute)
    client = wire(protocol)
    for number in range(3 * MAX_TRACKED):
        long(client, number)
    assert len(pilot.executed) == 3 * MAX_TRACKED
    for number in reversed(range(2 * MAX_TRACKED, 3 * MAX_TRACKED)):
        long(client, number, confirmation=1)
    assert len(pilot.executed) == 3 * MAX_TRACKED
    long(client, 2 * MAX_TRACKED - 1, confirmation=1)  # forgotten, so it is a new one
    assert len(pilot.executed) == 3 * MAX_TRACKED + 1
