"""Who looks on cannot disturb: not by hanging, not by dying, not by never reading."""

import json
import signal
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest
import zenoh

from guidance.flight import State
from guidance.links.zenoh.session import open_session
from guidance.log.broadcast import FLIGHT, MAX_BROADCASTS_WAITING, Broadcast, broadcast_key
from guidance.log.entries import CYCLE, EVENT, RELOADED, STOPPED
from guidance.log.writer import Record
from guidance.session.orders.control_bus import free_endpoint
from tests.harness.bus import open_to_all

ONLOOKER = """
import signal, sys
from guidance.links.zenoh.session import open_session
session = open_session(sys.argv[1])
session.declare_subscriber("guidance/uav1/live/*", lambda sample: None)
print("ready", flush=True)
signal.pause()
"""
ENDING = """
import json, sys, threading, time, zenoh
from guidance.links.zenoh.session import is_over
nobody = {"mode": "peer", "listen": {"endpoints": []}, "scouting": {"multicast": {"enabled": False}}}
session, asked = zenoh.open(zenoh.Config.from_json5(json.dumps(nobody))), threading.Event()
class Last:
    def __del__(self):
        time.sleep(0.1)  # the interpreter's own end lasts longer than a question
sys.last = Last()
def ask():
    while not is_over(threading.Event()):
        list(session.get("nobody/there", timeout=0.02))
        asked.set()
threading.Thread(target=ask).start()
asked.wait()
"""


@pytest.fixture
def bus():
    """A hosted session, its endpoint, and a broadcast on it."""
    endpoint = free_endpoint()
    session = open_to_all(endpoint)
    broadcast = Broadcast("uav1", session, {"seed": "3"})
    yield broadcast, endpoint
    broadcast.close()
    session.close()


def until(true, limit_s=5.0):
    """Wait for other threads and processes, which no clock of ours moves."""
    deadline_s = time.monotonic() + limit_s
    while not true():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def said(sample):
    return json.loads(sample.payload.to_bytes())


def hanging(endpoint):
    child = subprocess.Popen([sys.executable, "-c", ONLOOKER, endpoint], stdout=subprocess.PIPE)
    assert child.stdout.readline() == b"ready\n"
    return child


@pytest.mark.flight
def test_an_onlooker_that_hangs_and_dies_changes_no_setpoint(base, bus):
    broadcast, endpoint = bus
    child = hanging(endpoint)
    try:
        until(lambda: "cycle" in broadcast.watched())
        child.send_signal(signal.SIGSTOP)
        watched = base(broadcast=broadcast)
        watched.engaged()
        child.kill()
        watched.run(3.0)
    finally:
        child.kill()
        child.wait()
        child.stdout.close()
    alone = base.engaged().run(3.0)
    sent, wanted = (
        [(m.vx, m.vy, m.vz, m.yaw) for m in one.setpoints_since(0.0)] for one in (watched, alone)
    )
    assert len(wanted) > 100
    assert sent == wanted
    assert broadcast.waiting <= MAX_BROADCASTS_WAITING


def test_a_bus_that_never_takes_anything_holds_up_no_cycle_and_fills_no_memory(base):
    """Catches a broadcast that waits for its bus or grows."""
    never = threading.Event()

    class Stuck:
        matching_status = SimpleNamespace(matching=True)  # somebody has subscribed

        def put(self, _):
            never.wait()

    session = SimpleNamespace(
        declare_publisher=lambda key, **_: Stuck(),
        declare_queryable=lambda key, _: SimpleNamespace(undeclare=lambda: None),
    )
    broadcast = Broadcast("uav1", session, {"seed": "3"})
    base = base(broadcast=broadcast)
    base.engaged().run(3.0)  # a loop that waited would never come here
    assert base.state is State.ENGAGED
    assert broadcast.waiting == MAX_BROADCASTS_WAITING
    assert broadcast.dropped > 0
    never.set()
    broadcast.close()


def test_who_subscribes_hears_every_cycle_and_event_as_a_record_has_them(base, bus):
    broadcast, endpoint = bus
    heard = {"cycle": [], "event": []}
    with open_session(endpoint) as session:
        for what, kept in heard.items():
            session.declare_subscriber(
                broadcast_key("uav1", what),
                lambda sample, kept=kept: kept.append((str(sample.encoding), sample)),
            )
        until(lambda: broadcast.watched() == set(heard))
        base = base(broadcast=broadcast).until(State.READY)
        cycles = round(base.now_s / 0.02)
        until(lambda: len(heard["cycle"]) == cycles)
        until(lambda: heard["event"])
    encoding, last = heard["cycle"][-1]
    assert encoding == "application/json;guidance.Cycle"  # as BlueOS's recorder wants it
    cycle = said(last)
    assert (cycle["now_s"], cycle["state"]) == (pytest.approx(base.now_s), "ready")
    assert said(heard["event"][0][1])["event"] == "flight begins"


def test_nothing_is_laid_out_while_nobody_looks(base, bus, monkeypatch):
    for codec in (CYCLE, EVENT):
        monkeypatch.setattr(codec, "encode", lambda _: pytest.fail("laid out for nobody"))
    broadcast, _ = bus
    base(broadcast=broadcast).until(State.READY)
    until(lambda: broadcast.waiting == 0)
    assert broadcast.dropped == 0


def test_who_joins_late_is_told_what_the_vehicle_said_before(base, bus):
    """Catches a page that lacks what is said once only."""
    broadcast, endpoint = bus
    base = base(broadcast=broadcast).standing_by()
    until(lambda: broadcast.waiting == 0)
    with open_session(endpoint) as session:
        (reply,) = list(session.get(broadcast_key("*", FLIGHT), timeout=3.0))
        flight = json.loads(reply.ok.payload.to_bytes())
    assert reply.ok.encoding == zenoh.Encoding.APPLICATION_JSON
    assert (flight["name"], flight["metadata"]) == ("uav1", {"seed": "3"})
    known = CYCLE.decode(json.dumps(flight["heard"])).inputs
    kinds = [type(message).__name__ for message in known.messages]
    assert {"Home", "Origin", "LocalPosition", "Heartbeat"} <= set(kinds)
    assert len(kinds) == len(set(kinds))
    assert base.daemon.flight.vehicle.latest.get(type(known.messages[0])) is not None


def test_a_record_that_stops_is_an_event_on_the_bus(base, bus):
    full = Record("No space left on device")
    broadcast, endpoint = bus
    heard = []
    with open_session(endpoint) as session:
        session.declare_subscriber(broadcast_key("uav1", "event"), heard.append)
        until(lambda: "event" in broadcast.watched())
        base(broadcast=broadcast, record=full).run(0.2)
        until(lambda: STOPPED in [said(sample)["event"] for sample in heard])
    assert [said(sample)["detail"] for sample in heard].count(full.failed) == 1


def test_who_joins_after_a_configuration_was_read_again_is_told_the_new_one(bus):
    broadcast, endpoint = bus
    broadcast.event(1.0, RELOADED, '{"name": "uav1"}')
    until(lambda: broadcast.waiting == 0)
    with open_session(endpoint) as session:
        (reply,) = list(session.get(broadcast_key("uav1", FLIGHT), timeout=3.0))
    assert said(reply.ok)["metadata"] == {"seed": "3", "config": '{"name": "uav1"}'}


def test_how_a_flight_ended_is_said_before_its_broadcast_ends(bus):
    broadcast, endpoint = bus
    heard = []
    with open_session(endpoint) as session:
        session.declare_subscriber(broadcast_key("uav1", "event"), heard.append)
        until(lambda: "event" in broadcast.watched())
        broadcast.event(9.0, "disarmed", "landing -> landed")
        broadcast.close()
        until(lambda: heard)
    assert said(heard[0])["detail"] == "landing -> landed"


def test_an_interpreter_that_ends_waits_for_a_thread_in_zenoh_and_tells_it_to_end():
    # A daemon thread is cancelled there, and the process ends with "FATAL: exception not rethrown" and SIGABRT.
    ended = subprocess.run(
        [sys.executable, "-c", ENDING], capture_output=True, text=True, timeout=30.0, check=False
    )
    assert (ended.returncode, ended.stderr) == (0, "")
