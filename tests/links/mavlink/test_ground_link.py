"""Commands of ground stations: what strangers send takes neither time nor room from those who may order."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.clock import VirtualClock
from guidance.links import MemoryWire, SigningKey
from guidance.links.mavlink.frames import ticks
from guidance.links.mavlink.ground_link import (
    COMPONENT_ID,
    MOST_COMMANDS_PER_S,
    MOST_FORGED_PER_S,
    GroundLink,
)

UNIX_S = 1_800_000_000.0
KEY = bytes(range(32))
OTHER_KEY = bytes(32)
HOLD = 31010
QGC = 255
SECOND_STATION = 254


class Told:
    """A ground link, and senders on its wire."""

    def __init__(self, key=KEY):
        self.clock = VirtualClock()
        ours, self.theirs = MemoryWire.pair(self.clock.now_s)
        signing_key = None if key is None else SigningKey(key, UNIX_S)
        self.link = GroundLink(
            ours,
            self.clock.now_s,
            system_id=1,
            stations=[QGC, SECOND_STATION],
            signing_key=signing_key,
        )
        self.senders = {}

    def send(self, count=1, system_id=QGC, key=None):
        """Send commands to hold, signed with a key or not."""
        sender = self.senders.get((system_id, key))
        if sender is None:
            sender = self.senders[system_id, key] = mavlink.MAVLink(None, system_id, 190)
            if key is not None:
                sender.signing.secret_key = key
                sender.signing.sign_outgoing = True
                sender.signing.timestamp = ticks(UNIX_S)
        for _ in range(count):
            message = mavlink.MAVLink_command_long_message(1, COMPONENT_ID, HOLD, 0, *[0.0] * 7)
            self.theirs.send(message.pack(sender))

    def read(self):
        """Return who sent the commands that were read."""
        return [command.system_id for command in self.link.receive()]


@pytest.mark.parametrize("count", [MOST_COMMANDS_PER_S + 1, MOST_FORGED_PER_S])
def test_any_number_of_unsigned_commands_leaves_a_signed_one_unharmed(count):
    told = Told()
    told.send(count)
    told.send(key=KEY)
    assert told.read() == [QGC]
    assert told.link.counters()["unsigned"] == count


def test_forged_signatures_are_checked_up_to_a_number_in_each_second():
    told = Told()
    told.send(MOST_FORGED_PER_S - 1, key=OTHER_KEY)
    told.send(key=KEY)
    assert told.read() == [QGC]
    told.send(5, key=OTHER_KEY)
    told.send(key=KEY)
    assert told.read() == []
    counters = told.link.counters()
    assert (counters["refused"], counters["dropped"]) == (MOST_FORGED_PER_S, 5)
    told.clock.sleep_until(1.0)
    told.send(key=KEY)
    assert told.read() == [QGC]


@pytest.mark.parametrize("key", [None, KEY])
def test_each_station_has_a_number_of_commands_in_each_second(key):
    told = Told(key)
    told.send(MOST_COMMANDS_PER_S + 3, key=key)
    told.send(system_id=SECOND_STATION, key=key)
    assert told.read() == [*[QGC] * MOST_COMMANDS_PER_S, SECOND_STATION]
    assert told.link.counters()["dropped"] == 3
    told.clock.sleep_until(1.0)
    told.send(key=key)
    assert told.read() == [QGC]


def test_one_that_is_no_station_spends_nothing():
    told = Told(None)
    told.send(10 * MOST_COMMANDS_PER_S, system_id=9)
    told.send()
    assert told.read() == [QGC]
    assert told.link.counters()["foreign"] == 10 * MOST_COMMANDS_PER_S
