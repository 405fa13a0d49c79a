import pytest

from guidance.links.mavlink.requests import RequestQueue
from guidance.messages import (
    Command,
    CommandAck,
    FenceCount,
    FenceItem,
    FenceReceived,
    FenceRefused,
    FenceRequest,
    Parameter,
    ParameterRequest,
    ParameterSet,
)

ZEROS = (0.0,) * 7
ARM = Command(400, (1.0, *ZEROS[1:]))
STREAM = Command(511, (32.0, 20000.0, *ZEROS[2:]))


def sends(queue: RequestQueue, *times_s: float) -> list:
    return [
        (time_s, request, attempt) for time_s in times_s for request, attempt in queue.due(time_s)
    ]


def times(until_s: float, step_s: float = 0.1) -> list[float]:
    return [round(n * step_s, 3) for n in range(round(until_s / step_s) + 1)]


def test_a_question_is_sent_four_times_and_then_counts_as_unanswered():
    queue = RequestQueue()
    queue.add(STREAM)
    assert sends(queue, *times(5.0)) == [
        (0.0, STREAM, 0),
        (0.5, STREAM, 1),
        (1.0, STREAM, 2),
        (1.5, STREAM, 3),
    ]
    assert queue.unanswered == 1
    assert not any(queue.waiting.values())


@pytest.mark.parametrize("number", [20, 21, 22, 176, 192, 400])
def test_a_command_that_acts_is_never_repeated_blindly(number):
    queue = RequestQueue()
    command = Command(number, ZEROS)
    queue.add(command)
    assert sends(queue, *times(5.0)) == [(0.0, command, 0)]
    assert queue.unanswered == 1


@pytest.mark.parametrize("result", [0, 1, 2, 3, 4])
def test_an_answer_ends_the_repeats_whatever_it_says(result):
    queue = RequestQueue()
    queue.add(STREAM)
    assert len(sends(queue, 0.0)) == 1
    queue.hear(CommandAck(0.1, 511, result))
    assert sends(queue, *times(5.0)) == []
    assert queue.unanswered == 0


def test_an_answer_to_something_else_ends_nothing():
    queue = RequestQueue()
    queue.add(STREAM)
    sends(queue, 0.0)
    queue.hear(CommandAck(0.1, 176, 0))
    assert len(sends(queue, 0.5)) == 1


def test_an_answer_from_before_the_request_was_sent_is_not_its():
    queue = RequestQueue()
    queue.add(ARM)
    queue.hear(CommandAck(0.0, 400, 0))
    assert len(sends(queue, 0.0)) == 1


def test_in_progress_is_waited_for_and_not_repeated():
    queue = RequestQueue()
    queue.add(STREAM)
    sends(queue, 0.0)
    queue.hear(CommandAck(0.1, 511, 5))
    assert sends(queue, *times(9.0)) == []
    assert queue.unanswered == 0
    sends(queue, 10.2)
    assert queue.unanswered == 1


def test_a_new_mode_takes_the_place_of_the_one_that_waits_at_once():
    queue = RequestQueue()
    offboard = Command(176, (1, 6, *ZEROS[2:]))
    hold = Command(176, (1, 4, 3, *ZEROS[3:]))
    queue.add(offboard)
    assert sends(queue, 0.0) == [(0.0, offboard, 0)]
    queue.add(hold)
    assert sends(queue, 0.02) == [(0.02, hold, 0)]
    queue.hear(CommandAck(0.1, 176, 0))
    assert not any(queue.waiting.values())


def test_stream_requests_queue_one_behind_another():
    queue = RequestQueue()
    streams = [Command(511, (float(message), 20000.0, *ZEROS[2:])) for message in (30, 32, 33)]
    for stream in streams:
        queue.add(stream)
    sent = []
    for step in range(3):
        sent += [request for request, _ in queue.due(0.02 * step)]
        queue.hear(CommandAck(0.02 * step + 0.01, 511, 0))
    assert sent == streams
    assert not any(queue.waiting.values())


def test_parameters_wait_side_by_side_and_are_answered_by_name():
    queue = RequestQueue()
    queue.add(ParameterRequest("A"))
    queue.add(ParameterRequest("B"))
    assert len(sends(queue, 0.0)) == 2
    queue.hear(Parameter(0.0, "A", 1.0))
    assert [request.name for _, request, _ in sends(queue, 0.5)] == ["B"]


def test_a_parameter_that_is_set_is_answered_by_its_value_and_set_again_until_then():
    queue = RequestQueue()
    queue.add(ParameterSet("A", 5.0, 6))
    assert len(sends(queue, *times(1.2))) == 3
    queue.hear(Parameter(0.0, "A", 1.0))
    assert not any(queue.waiting.values())


def test_the_fence_is_asked_for_one_step_at_a_time_until_it_is_answered():
    queue = RequestQueue()
    queue.add(FenceRequest())
    assert [request for _, request, _ in sends(queue, *times(1.0))] == [FenceRequest()] * 3
    queue.hear(FenceItem(0.0, 0, 5001, 4.0, 47.0, 8.0))  # another one
    assert any(queue.waiting.values())
    queue.hear(FenceCount(0.0, 2))
    assert not any(queue.waiting.values())
    queue.add(FenceRequest(0))
    queue.add(FenceRequest(1))  # takes the place of the one before
    assert [request for _, request, _ in sends(queue, 5.0)] == [FenceRequest(1)]
    queue.hear(FenceRefused(0.0, 1))
    assert not any(queue.waiting.values())
    assert queue.unanswered == 0


def test_the_end_of_a_fence_transfer_is_sent_once_without_waiting():
    queue = RequestQueue()
    queue.add(FenceReceived())
    assert [request for _, request, _ in sends(queue, *times(3.0))] == [FenceReceived()]
    assert queue.unanswered == 0
    assert not any(queue.waiting.values())


def test_the_queue_is_bounded():
    queue = RequestQueue()
    for message in range(200):
        queue.add(Command(511, (float(message), *ZEROS[1:])))
    assert queue.refused == 200 - 64
