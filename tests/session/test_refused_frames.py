"""Frames in the vehicle's name that its link refuses: operator and record see them, and not in every second."""

import pytest

from guidance.flight import State
from guidance.links.wires.udp import AddressPins
from guidance.log.entries import LINK_NEWS
from guidance.session.observe.refused import LOG_EVERY_S, RefusedFrames
from tests.session.test_other_heartbeats import COMPANION, heartbeat

pytestmark = pytest.mark.flight


def test_frames_that_the_link_refuses_are_an_event_and_change_nothing(base):
    one = base(key=bytes(range(32))).standing_by()
    for _ in range(600):
        one.overheard(heartbeat(COMPANION))
        one.cycle()
    assert one.state is State.STANDING_BY
    said = [words for words in one.log.messages() if words.startswith("frames in the vehicle's")]
    assert said[0].startswith("frames in the vehicle's name were refused: ")
    assert said[0].endswith("without a signature")
    assert len(said) == 2
    labels = {"vehicle": one.daemon.name, "event": LINK_NEWS}
    assert one.metrics.registry.get_sample_value("guidance_events_total", labels) == 2.0


def test_impostors_are_counted_for_the_system_whose_id_they_have():
    pins = AddressPins((1, 2))
    for system in (1, 2, 1):
        pins.admit(1.0, ("true", system), heartbeat(COMPANION, system_id=system))
    pins.admit(1.1, ("true", 2), b"?" + heartbeat(COMPANION, system_id=1))
    pins.admit(1.2, ("other", 9), heartbeat(COMPANION, system_id=1))
    assert dict(pins.impostors_of) == {1: 2}
    frames = RefusedFrames()
    words = "frames in the vehicle's name were refused: 2 from another address"
    assert frames.note(1.0, {"impostors": pins.impostors_of[1]}) == words
    assert frames.note(2.0, {"impostors": 5}) == ""
    assert frames.note(1.0 + LOG_EVERY_S, {"impostors": 5}).endswith("3 from another address")
