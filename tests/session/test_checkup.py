"""`guidance check --apply`: set on the ground, read back, judged again, and refused wherever it could do harm."""

import json
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.autopilots import autopilot_named
from guidance.clock import VirtualClock
from guidance.config import parse_document
from guidance.errors import FlightError
from guidance.links import MemoryWire
from guidance.links import world as worlds
from guidance.links.evaders.carriers import GLOBAL_POSITION
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.preflight import refusals
from guidance.session.checkup import Checkup
from guidance.session.plan import plan_of
from guidance.session.vehicle_file import Config
from sitl_mock import MockVehicle
from sitl_mock.child import running
from sitl_mock.faults import Faulted
from tests.harness.command import guidance
from tests.links.peer import Peer

GUIDANCE = Path(sys.executable).parent / "guidance"


class World(VirtualClock):
    """A vehicle on the ground with its defaults; whoever waits for this clock moves it."""

    def __init__(self, vehicle_document, autopilot, flown=None, **how):
        super().__init__()
        self.vehicle = MockVehicle(flown or autopilot, ready_after_s=1.0)
        self.faulted = Faulted(self.vehicle, "uav1")
        ours, self._end = MemoryWire.pair(self.now_s)
        evaders_wire, self.evader_end = MemoryWire.pair(self.now_s)
        self.link = PymavlinkLink(ours, self.now_s, system_id=1)
        document = vehicle_document(
            vehicle={"autopilot": autopilot, "url": "udpin://127.0.0.1:14540"}
        )
        plan = plan_of(parse_document(Config, document, source="test"))
        self.autopilot = autopilot_named(autopilot)
        self.said = []
        self.other = None
        evader = MavlinkEvader(
            evaders_wire, GLOBAL_POSITION, system_id=2, clock=self.now_s, request_rate_hz=5.0
        )
        world = worlds.World({"uav1": self.link}, {"uav1": {"evader": evader}})
        self.checkup = Checkup("uav1", plan, world, self, **how)

    def sleep_until(self, moment_s):
        while self.now_s() < moment_s - 1e-9:
            if self.other is not None and self.now_s() % 1.0 < 0.02:
                self.other.say(mavlink.MAVLink_heartbeat_message(10, 3, 0, 0, 4, 3))
            super().sleep_until(min(moment_s, self.now_s() + 0.02))
            heard = [frame for _, frame in self._end.receive()]
            self.said += [
                mavlink.MAVLink(None).decode(bytearray(frame)).get_type() for frame in heard
            ]
            for frame in self.faulted.step(self.now_s(), heard):
                self._end.send(frame)

    def value(self, name):
        return self.vehicle.autopilot.parameters[name]


@pytest.fixture
def world(vehicle_document):
    return lambda autopilot="px4": World(vehicle_document, autopilot)


@pytest.mark.parametrize("autopilot", ["px4", "arducopter"])
def test_what_is_refused_is_set_read_back_and_passes(world, autopilot):
    there = world(autopilot)
    refused = refusals(there.checkup.rows())
    wanted = there.checkup.changes(advised=False)
    assert {one.name for one in wanted} == set(refused)
    assert "PARAM_SET" not in there.said
    done = list(there.checkup.apply(wanted))
    assert [name for name, _, _ in done] == [one.name for one in wanted]
    assert all(kept for _, _, kept in done), done
    assert all(there.value(one.name) == pytest.approx(one.request.value) for one in wanted)
    assert refusals(there.checkup.rows()) == ()
    assert there.said.count("PARAM_SET") == len(wanted)
    assert not {"COMMAND_INT", "SET_MODE", "SET_POSITION_TARGET_LOCAL_NED"} & set(there.said)


def test_integers_of_px4_are_set_as_integers(world):
    there = world()
    there.checkup.rows()
    done = list(there.checkup.apply(there.checkup.changes(advised=True)))
    assert there.value("COM_OBL_RC_ACT") == 5
    assert all(kept for _, _, kept in done), done


def test_a_value_that_the_autopilot_does_not_keep_is_said_to_be_so(world):
    there = world()
    there.checkup.rows()
    wanted = there.checkup.changes(advised=False)
    there.faulted.inject({"kind": "param_echo", "parameter": "GF_MAX_HOR_DIST", "value": 50.0})
    done = list(there.checkup.apply(wanted))
    assert [one for one in done if not one[-1]] == [("GF_MAX_HOR_DIST", 50.0, False)]
    assert "GF_MAX_HOR_DIST" in refusals(there.checkup.rows())


def test_an_autopilot_that_answers_nothing_is_asked_again_and_then_given_up(world):
    """Catches a set-up that waits for ever for a lost answer."""
    there = world()
    there.checkup.rows()
    wanted = there.checkup.changes(advised=False)[:1]
    there.faulted.inject(
        {"kind": "loss", "probability": 1.0, "messages": ["PARAM_VALUE"], "direction": "out"}
    )
    done = list(there.checkup.apply(wanted))
    assert done == [(wanted[0].name, None, False)]
    assert there.said.count("PARAM_SET") == 4


@pytest.mark.parametrize(("configured", "flown"), [("px4", "arducopter"), ("arducopter", "px4")])
def test_a_wrong_autopilot_is_the_only_row_at_the_time_limit(vehicle_document, configured, flown):
    world = World(vehicle_document, configured, flown)
    (row,) = world.checkup.rows(limit_s=4.0)
    assert 4.0 <= world.now_s() < 4.1
    assert refusals([row]) == ("autopilot",)
    assert row.value.startswith(f"{flown} (MAV_AUTOPILOT")
    assert f'set vehicle.autopilot = "{flown}"' in row.advice


def test_what_is_waited_for_is_told(world):
    told = []
    world("px4").checkup.rows(report=told.append)
    assert "HOME_POSITION" in told[0]
    assert "parameters" in told[0]
    assert told[-1] == ""


def test_the_system_that_is_there_instead_of_a_silent_evader_is_named(world):
    there = world()
    there.other = Peer(there.evader_end.send, system_id=7)
    sources = [row.value for row in there.checkup.rows() if row.name == "evader's source"]
    assert ["Heard: system 7, component 1" in value for value in sources] == [True]


def test_an_evader_that_the_flight_will_simulate_is_not_missed(vehicle_document):
    silent = World(vehicle_document, "px4").checkup.rows()
    simulated = World(vehicle_document, "px4", evader_simulated=True).checkup.rows()
    names = [row.name for row in silent]
    assert "evader's altitude" in names
    names.remove("evader's altitude")
    assert [row.name for row in simulated] == names


def test_nothing_is_set_while_the_vehicle_is_armed(world):
    there = world()
    there.checkup.rows()
    wanted = there.checkup.changes(advised=False)
    there.said.clear()
    there.link.request(there.autopilot.arm())
    there.checkup.rows(limit_s=2.0)
    assert there.vehicle.armed
    with pytest.raises(
        FlightError, match="the vehicle is armed: parameters are set on the ground only, disarmed"
    ):
        list(there.checkup.apply(wanted))
    assert "PARAM_SET" not in there.said


def test_a_vehicle_that_is_armed_in_the_middle_of_it_gets_no_more(world):
    there = world("arducopter")
    there.checkup.rows()
    applied = there.checkup.apply(there.checkup.changes(advised=False))
    next(applied)
    there.link.request(there.autopilot.arm())
    there.checkup.rows(limit_s=2.0)
    with pytest.raises(FlightError, match="the vehicle is armed"):
        next(applied)
    assert there.said.count("PARAM_SET") == 1


def test_a_vehicle_that_does_not_say_where_it_is_is_left_alone(world):
    there = world()
    there.faulted.inject(
        {"kind": "loss", "probability": 1.0, "messages": ["EXTENDED_SYS_STATE"], "direction": "out"}
    )
    there.checkup.rows()
    with pytest.raises(FlightError, match="does not say whether it is on the ground"):
        list(there.checkup.apply(there.checkup.changes(advised=False)))


@pytest.mark.slow
@pytest.mark.parametrize(("autopilot", "link"), [("px4", "mavsdk"), ("arducopter", "pymavlink")])
def test_a_vehicle_at_a_url_is_set_up_without_any_file(autopilot, link):
    with running(
        [{"name": "uav1", "flavour": autopilot, "ready_after_s": 1.0}], over=["udp"]
    ) as fleet:
        at = ("--vehicle", fleet["uav1"].udp, "--link", link)
        refused = guidance("check", *at, "--apply", said="n\n")
        assert refused.returncode == 4
        assert "Set these" in refused.stderr
        assert ("GF_MAX_HOR_DIST" if autopilot == "px4" else "FENCE_ENABLE") in refused.stdout
        set_up = guidance("check", *at, "--apply", "--advised", "--yes", "--json")
        assert set_up.returncode == 0, set_up.stdout + set_up.stderr
        assert not [row for row in json.loads(set_up.stdout) if row["verdict"] == "refuse"]
        again = guidance("check", *at, "--apply")
    assert again.returncode == 0
    assert "no parameter needs to be set" in again.stdout
    assert "nothing is refused" in again.stdout
    assert "evader" not in again.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("check",), "give a vehicle file, or --vehicle URL"),
        (("check", "px4", "--yes"), "only with --apply"),
        (("check", "px4", "--apply", "--json"), "asks a question with --apply; add --yes"),
        (("check", "nonsense", "--vehicle", "udpin://127.0.0.1:14540"), "no scenario 'nonsense'"),
    ],
)
def test_arguments_that_cannot_be_meant_are_refused(arguments, words):
    done = guidance(*arguments)
    assert done.returncode == 2
    assert words in done.stderr
