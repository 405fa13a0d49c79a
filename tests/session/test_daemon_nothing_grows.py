"""The same again in one process leaves nothing behind: whole flights with their records, orders, reloads.

`tests/bench/bench_many.py` does it hundreds of times and looks at memory; here every object and descriptor is counted.
"""

import gc
import json
from pathlib import Path

import pytest

from guidance.clock import VirtualClock
from guidance.flight import State
from guidance.log.writer import Recorder
from guidance.session.fly.daemon import Daemon, Equipment
from guidance.session.fly.mission import Mission
from guidance.session.plan import plan_of
from guidance.session.service import reload
from guidance.session.vehicle_file import Config
from guidance.sim.stepped import SteppedWorld
from tests.harness.flights import NEAR


def left():
    """Return the numbers of objects and of open descriptors after a garbage collection."""
    gc.collect()
    return len(gc.get_objects()), len(list(Path("/proc/self/fd").iterdir()))


def growth(once, *, warm, times):
    """Return how much more is left after so many times than before, the first few not counted."""
    for number in range(warm):
        once(number)
    objects, descriptors = left()
    for number in range(warm, warm + times):
        once(number)
    after = left()
    return after[0] - objects, after[1] - descriptors


class Silent:
    """A link, or an evader's reports, without a vehicle."""

    def receive(self):
        return ()

    def send_heartbeat(self):
        """Nobody hears it."""

    def request(self, _request):
        """Nobody answers."""

    def counters(self):
        return {}


@pytest.fixture
def grounded(tmp_path, vehicle_document):
    """A daemon that waits for its vehicle, its file, and a cycle of it."""
    config = Config.model_validate(vehicle_document())
    path = tmp_path / "uav1.toml"
    text = [f"name = {json.dumps(config.name)}"]
    for section, keys in vehicle_document().items():
        if isinstance(keys, dict):
            text += [
                f"[{section}]",
                *(f"{key} = {json.dumps(value)}" for key, value in keys.items()),
            ]
    path.write_text("\n".join(text))
    daemon = Daemon(config.name, plan_of(config), Silent(), {"evader": Silent()}, Equipment())
    return daemon, lambda: reload(path, config)


@pytest.mark.flight
@pytest.mark.long
def test_a_whole_flight_leaves_nothing(tmp_path):
    def once(number):
        clock = VirtualClock()
        world = SteppedWorld(NEAR.model_copy(update={"seed": number}), clock)
        record = Recorder(tmp_path / "record.mcap", {})
        flown = Mission(NEAR, world, clock, equipment={"pursuer": Equipment(record=record)}).fly()
        assert flown.vehicles["pursuer"].ended is State.LANDED
        record.close()
        world.close()

    objects, descriptors = growth(once, warm=1, times=1)
    assert descriptors == 0
    assert objects < 20  # a flight has some 100,000


def test_orders_leave_nothing(grounded):
    """Catches an order that stays in memory."""
    daemon, _ = grounded
    words = ("status", "hold", "reset", "engage")

    def once(number):
        question = daemon.mailbox.ask(words[number % 4])
        daemon.step(0.02 * number)
        assert question.result(0.0)["order"] == words[number % 4]

    objects, descriptors = growth(once, warm=20, times=40)
    assert descriptors == 0
    assert objects < 20


def test_reloads_leave_nothing(grounded):
    """Catches a flight that stays in memory after a reload."""
    daemon, load_again = grounded

    def once(number):
        before = daemon.flight
        daemon.exchange(load_again, 0.02 * number)
        assert daemon.flight is not before
        daemon.step(0.02 * number)

    objects, descriptors = growth(once, warm=5, times=30)
    assert descriptors == 0
    assert objects < 20
