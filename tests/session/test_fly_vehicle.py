"""A vehicle that runs elsewhere: found, refused for a reason, or flown against our own evader and brought home."""

import math
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.autopilots import AUTOPILOTS
from guidance.clock import VirtualClock
from guidance.config import load
from guidance.errors import ConfigError, FlightError, LinkError
from guidance.flight import Event, State
from guidance.links import MemoryWire
from guidance.links import world as worlds
from guidance.links.evaders.carriers import GLOBAL_POSITION
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.links.opening import Found, find_autopilot
from guidance.links.port import parse
from guidance.links.section import Vehicle
from guidance.links.wires.base import TappedWire
from guidance.session.fly.mission import MissionPolicy
from guidance.session.fly.result import outcome_of_flight
from guidance.session.open.discovery import identify, wait_until_placed
from guidance.session.open.url import laid_about
from guidance.session.plan import config_of, plan_of
from guidance.sim.scenario import EVADER_ID, Scenario
from guidance.sim.stepped import EvaderHere, SteppedMock
from sitl_mock import Home, MockVehicle
from sitl_mock.child import running
from sitl_mock.faults import Faulted
from tests.harness.command import guidance
from tests.harness.supervised import Supervised
from tests.harness.vehicle import SOON_UP_AND_DOWN

GUIDANCE = Path(sys.executable).parent / "guidance"
NEAR_FILE = Path(__file__).parents[1] / "data" / "near_chase.toml"
NEAR = load(Scenario, NEAR_FILE)
FIELD = Home(46.5, 7.25, 830.0)
FENCED = {
    "px4": {
        "GF_MAX_HOR_DIST": 400.0, "GF_MAX_VER_DIST": 200.0, "RTL_RETURN_ALT": 5.0, "RTL_DESCEND_ALT": 5.0,
        **SOON_UP_AND_DOWN,
    },
    "arducopter": {
        "GUID_TIMEOUT": 1.0, "FENCE_ENABLE": 1.0, "FENCE_TYPE": 3.0, "FENCE_RADIUS": 400.0, "FENCE_ALT_MAX": 200.0,
    },
}  # fmt: skip
PX4_FOUND = Found(1, 1, 12, 2)


class World(VirtualClock):
    """A vehicle somewhere else; whoever waits for this clock moves it."""

    def __init__(self, autopilot="px4", *, ready_after_s=0.5, parameters=None):
        super().__init__()
        self.vehicle = MockVehicle(
            autopilot,
            home=FIELD,
            ready_after_s=ready_after_s,
            parameters=FENCED[autopilot] if parameters is None else parameters,
        )
        self.faulted = Faulted(self.vehicle, "pursuer")
        self.mock = SteppedMock(self.faulted, self)
        self.tap = TappedWire(self.mock.wire(), self.now_s, "pursuer")
        self.link = PymavlinkLink(self.tap, self.now_s, system_id=1)
        self.profile = AUTOPILOTS[autopilot]
        self.shown = []

    def sleep_until(self, moment_s):
        while self.now_s() < moment_s - 1e-9:
            super().sleep_until(min(moment_s, self.now_s() + 0.02))
            self.mock.advance(self.now_s())

    def meet(self):
        return wait_until_placed(self.link, self.profile, self, self.shown.append)

    def by_hand(self, *requests, until, limit_s=40.0):
        """Send requests from another sender with its own link, and wait until the condition holds."""
        other = PymavlinkLink(
            self.mock.wire(), self.now_s, system_id=1, own_system_id=255, own_component_id=190
        )
        for request in requests:
            other.request(request)
        end_s = self.now_s() + limit_s
        while not until() and self.now_s() < end_s:
            other.send_heartbeat()
            self.sleep_until(self.now_s() + 0.1)
        assert until()

    def ordered(self):
        """Return our messages to the vehicle that change something, without heartbeats and queries."""
        frames = [one.frame for one in self.tap.drain() if one.topic.endswith("/in")]
        messages = [mavlink.MAVLink(None).decode(bytearray(frame)) for frame in frames]
        return [
            message for message in messages
            if message.get_type() not in {"HEARTBEAT", "TIMESYNC", "PARAM_REQUEST_READ", "MISSION_REQUEST_LIST",
                                      "MISSION_REQUEST_INT", "MISSION_ACK"}
            and getattr(message, "command", None) not in {511, 512}
        ]  # fmt: skip


class Sortie(Supervised):
    """The daemon of `guidance fly --vehicle`, and its evader, in virtual time."""

    def __init__(self, world, *, scenario=NEAR):
        name = world.profile.name
        self.laid = laid_about(scenario, *world.meet(), name)
        vehicle = Vehicle(autopilot=name, link="pymavlink", url="udpin://127.0.0.1:14540")
        self.own = config_of(scenario, "pursuer", vehicle)
        ears, radio = MemoryWire.pair(world.now_s)
        self.evader = EvaderHere(self.laid, world, radio)
        source = MavlinkEvader(ears, GLOBAL_POSITION, system_id=EVADER_ID, clock=world.now_s)
        self.shown = []
        super().__init__(
            world,
            worlds.World(
                {"pursuer": world.link},
                {"pursuer": {"evader": source}},
                players={"evader": self.evader},
            ),
            plan=plan_of(self.own, self.laid),
            scenario=self.laid,
            policy=MissionPolicy(engage=True, end_with=Event.RETURN, hand_over=Event.LAND),
            show=self.shown.append,
        )

    def outcome(self):
        return outcome_of_flight(self.result, "vehicle")


@pytest.fixture
def sortie():
    made = []

    def make(world, **options):
        made.append(Sortie(world, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.mark.flight
@pytest.mark.parametrize("autopilot", ["px4", pytest.param("arducopter", marks=pytest.mark.long)])
def test_a_scenario_is_flown_about_the_home_of_a_vehicle_that_stands_elsewhere_and_comes_home(
    sortie, autopilot
):
    world = World(autopilot)
    flown = sortie(world).run()
    outcome = flown.outcome()
    assert (outcome.run, outcome.end, flown.state) == ("vehicle", "captured", State.LANDED)
    assert 0.8 < outcome.ratio < 1.15
    assert not world.vehicle.armed
    assert math.hypot(*world.vehicle.truth.position_ned_m[:2]) < 2.0
    began = next(sample for sample in flown.result.samples if sample.state is State.ENGAGED)
    assert math.dist(began.pursuer_m, NEAR.pursuer.position_m) < 2.5
    assert math.dist(began.evader_m[:2], NEAR.evader.position_m) < 0.5
    assert not flown.mission.stop(0.0).vehicles["pursuer"].interrupted


def test_the_game_frame_is_laid_so_that_the_vehicles_home_is_the_scenarios():
    world = World()
    laid = laid_about(NEAR, *world.meet(), "px4")
    x, y = NEAR.home_m
    assert laid.site.latitude_deg == pytest.approx(FIELD.lat_deg - y / 111_320.0, abs=2e-6)
    assert laid.site.longitude_deg == pytest.approx(FIELD.lon_deg - x / 76_600.0, abs=2e-6)
    assert laid.site.altitude_amsl_m == pytest.approx(FIELD.alt_amsl_m, abs=3.0)


def test_faults_and_wind_that_only_a_mock_can_have_fall_away_and_the_evaders_stay():
    fault = {"kind": "gps_loss", "at_s": 3.0}
    scenario = Scenario.model_validate(
        NEAR.model_dump()
        | {
            "wind": {"velocity_m_s": (1.0, 0.0)},
            "fault": (
                fault,
                {"kind": "evader_silent", "vehicle": "evader", "at_s": 2.0, "for_s": 1.0},
            ),
        }
    )
    laid = laid_about(scenario, *World().meet(), "arducopter")
    assert [one.vehicle for one in laid.fault] == ["evader"]
    assert laid.wind.velocity_m_s == (0.0, 0.0)
    assert laid.pursuer.autopilot == "arducopter"


def test_an_arducopter_that_has_just_been_switched_on_is_waited_for(sortie):
    """Catches a run that gives up before the estimator has settled."""
    world = World("arducopter", ready_after_s=None)
    flown = sortie(world)
    flown.run(until=lambda: flown.state is State.ARMING)
    assert flown.state is State.ARMING
    assert world.now_s() > 35.0
    waited = {one.waiting for one in (*world.shown, *flown.shown) if one.waiting}
    assert any(
        "not received" in words or "the autopilot's own checks fail" in words for words in waited
    ), waited


def test_a_vehicle_that_never_gets_ready_is_given_up_with_the_reason_and_nothing_armed(
    sortie, monkeypatch
):
    """Catches a run that waits for ever or arms meanwhile."""
    monkeypatch.setattr("guidance.session.fly.mission.READY_WITHIN_S", 10.0)
    world = World()
    flown = sortie(world)
    world.faulted.inject({"kind": "arm_refused", "text": "Compass not calibrated"})
    with pytest.raises(
        FlightError, match=r"not ready to fly within 10 s: prearm .*nothing was armed"
    ):
        flown.run()
    assert world.ordered() == []
    assert not world.vehicle.armed


def test_a_vehicle_that_does_not_know_its_place_is_given_up(monkeypatch):
    monkeypatch.setattr("guidance.session.open.discovery.PLACED_WITHIN_S", 6.0)
    world = World()
    world.sleep_until(0.1)
    world.faulted.inject(
        {"kind": "loss", "probability": 1.0, "messages": ["HOME_POSITION"], "direction": "out"}
    )
    with pytest.raises(
        FlightError, match=r"not ready within 6 s: HOME_POSITION not received.*Nothing was armed"
    ):
        world.meet()
    assert world.ordered() == []


@pytest.mark.parametrize("autopilot", ["px4", "arducopter"])
def test_a_vehicle_that_another_hand_has_armed_is_refused(autopilot):
    world = World(autopilot)
    world.sleep_until(4.0)
    guided = world.profile.set_mode(world.profile.arming_mode)
    world.by_hand(guided, world.profile.arm(), until=lambda: world.vehicle.armed)
    with pytest.raises(
        FlightError, match="armed by someone else: disarm it first; no order was given"
    ):
        world.meet()
    assert world.ordered() == []


def test_a_vehicle_in_the_air_is_refused():
    world = World()
    world.sleep_until(4.0)
    home, _ = world.meet()
    takeoff = world.profile.takeoff(height_m=10.0, home_amsl_m=home.altitude_amsl_m)
    world.by_hand(world.profile.arm(), until=lambda: world.vehicle.armed)
    world.by_hand(takeoff, until=lambda: world.vehicle.truth.position_ned_m[2] < -8.0)
    world.ordered()
    with pytest.raises(
        FlightError, match="in the air already: land and disarm it first; no order was given"
    ):
        world.meet()
    assert world.ordered() == []


def test_a_vehicle_that_another_hand_arms_while_it_is_checked_is_left_to_them(sortie):
    world = World()
    flown = sortie(world)
    world.by_hand(world.profile.arm(), until=lambda: world.vehicle.armed)
    with pytest.raises(FlightError, match="the vehicle is armed already"):
        flown.run()
    assert world.ordered() == []


def test_preflight_refuses_on_the_ground_and_names_what_is_wrong(sortie):
    world = World(parameters={})
    with pytest.raises(FlightError, match=r"preflight refuses: GF_MAX_HOR_DIST.*GF_MAX_VER_DIST"):
        sortie(world).run()
    assert world.ordered() == []


def test_a_check_that_fails_as_the_vehicle_is_to_arm_ends_the_run_and_is_named(sortie):
    """Catches a refused arming whose reason is lost on the way to the result."""
    world = World("arducopter")
    flown = sortie(world)
    flown.run(until=lambda: flown.state is State.ARMING)
    world.faulted.inject({"kind": "arm_refused", "text": "Compass not calibrated"})
    flown.run()
    outcome = flown.outcome()
    assert outcome.end == "failed"
    assert "while arming (the autopilot's own checks fail in GUIDED)" in outcome.reason
    assert not world.vehicle.armed


def test_whoever_ends_the_run_in_flight_has_the_vehicle_landed(sortie):
    """Catches a vehicle that is left in the air by the end of a run."""
    world = World()
    flown = sortie(world)
    flown.run(until=lambda: flown.state is State.ENGAGED)
    assert flown.state is State.ENGAGED
    flown.daemon.leave(Event.LAND, world.now_s())
    flown.run(20.0)
    assert (flown.state, world.vehicle.mode) == (State.LANDING, "LAND")
    assert flown.mission.stop(0.0).vehicles["pursuer"].interrupted


@pytest.mark.parametrize(
    ("found", "asked", "words"),
    [
        (PX4_FOUND._replace(autopilot=3), "px4", r"is arducopter, not --autopilot px4"),
        (PX4_FOUND, "arducopter", r"is px4, not --autopilot arducopter"),
        (PX4_FOUND, "copter", "autopilot = 'copter': allowed are px4, arducopter"),
        (
            PX4_FOUND._replace(autopilot=4),
            None,
            r"MAV_AUTOPILOT 4; supported are px4 \(12\) and arducopter \(3\)",
        ),
        (
            PX4_FOUND._replace(autopilot=3, vehicle_type=10),
            None,
            "MAV_TYPE 10: arducopter is flown as a multicopter only",
        ),
        (
            PX4_FOUND._replace(vehicle_type=1),
            None,
            "MAV_TYPE 1: px4 is flown as a multicopter only",
        ),
    ],
)
def test_an_autopilot_that_is_not_flown_or_not_meant_is_refused(found, asked, words):
    with pytest.raises(ConfigError, match=words):
        identify(found, "udpin://127.0.0.1:14540", asked)


def test_the_flavour_is_found_where_none_is_given():
    assert identify(PX4_FOUND, "url", None).name == "px4"
    assert identify(PX4_FOUND._replace(autopilot=3), "url", "arducopter").name == "arducopter"


def beat(system_id, component_id, kind, autopilot, base_mode=0):
    sender = mavlink.MAVLink(None, system_id, component_id)
    return bytes(
        mavlink.MAVLink_heartbeat_message(kind, autopilot, base_mode, 0, 3, 3).pack(sender)
    )


def test_the_first_autopilot_is_found_among_ground_stations_cameras_and_garbage():
    clock = VirtualClock()
    ours, end = MemoryWire.pair(clock.now_s)
    for frame in (beat(255, 190, 6, 8), b"\x00garbage", beat(7, 100, 30, 8), beat(7, 1, 2, 3, 128)):
        end.send(frame)
    found = find_autopilot(
        ours, clock=clock.now_s, timeout_s=1.0, sleep=lambda _: None, who="there"
    )
    assert found == Found(7, 1, 3, 2)
    # Our own HEARTBEAT, without which a vehicle that is called would not answer
    assert len(end.receive()) == 1


def test_where_no_autopilot_is_heard_it_is_said_what_was():
    clock = VirtualClock()
    ours, end = MemoryWire.pair(clock.now_s)
    end.send(beat(255, 190, 6, 8))
    with pytest.raises(
        LinkError, match=r"there: no autopilot's HEARTBEAT within 4 s \(1 other frames heard\)"
    ):
        find_autopilot(
            ours,
            clock=clock.now_s,
            timeout_s=4.0,
            sleep=lambda by_s: clock.sleep_until(clock.now_s() + by_s),
            who="there",
        )
    assert len(end.receive()) == 5


@pytest.mark.parametrize(
    ("url", "here"),
    [
        ("udpin://127.0.0.1:14540", True),
        ("tcpout://localhost:5760", True),
        ("udpout://127.3.2.1:14540", True),
        ("udpin://[::1]:14540", True),
        ("udpin://0.0.0.0:14540", False),
        ("tcpout://192.168.4.1:5760", False),
        ("udpout://drone.local:14540", False),
        ("serial:///dev/ttyACM0:57600", False),
    ],
)
def test_only_what_is_on_loopback_counts_as_a_simulator(url, here):
    assert parse(url).on_loopback is here


def test_a_vehicle_that_may_be_real_is_asked_for_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = guidance("fly", "--vehicle", "udpin://0.0.0.0:14999", said="n\n")
    assert done.returncode == 4
    assert "may be a real vehicle. Arm and fly it?" in done.stdout + done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("--vehicle", "udpin://127.0.0.1:14540", "--fast"),
            "--fast: only without it, with the mock",
        ),
        (
            ("--vehicle", "udpin://127.0.0.1:14540", "--port", "7000"),
            "--port: only without it, with the mock",
        ),
        (("--vehicle", "px4"), "url = 'px4'"),
        (
            ("--vehicle", "udpin://127.0.0.1:14540", "--end", "hover"),
            "--end hover: allowed are return, land",
        ),
        (
            ("--vehicle", "udpin://127.0.0.1:14540", "--link", "ros"),
            "--link ros: allowed are mavsdk, pymavlink",
        ),
    ],
)
def test_arguments_that_cannot_be_meant_are_refused(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    done = guidance("fly", *arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.long
def test_guidance_fly_flies_a_vehicle_that_was_started_elsewhere(tmp_path):
    """`tests.acceptance` flies both autopilots and both links so; they land where the game ended."""
    vehicle = {
        "name": "uav1",
        "flavour": "px4",
        "ready_after_s": 1.0,
        "parameters": FENCED["px4"],
    }
    with running([vehicle], over=["udp"]) as fleet:
        out = tmp_path / "out"
        done = subprocess.run(
            [GUIDANCE, "fly", NEAR_FILE, "--vehicle", fleet["uav1"].udp, "--out", out],
            capture_output=True, text=True, timeout=150, check=False, env={**os.environ, "COLUMNS": "200"},
        )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "captured" in done.stdout
    assert float(re.search(r"flown / predicted +([\d.]+)", done.stdout)[1]) > 0.8
    assert re.search(r"flight ended +landed", done.stdout)
    assert (out / "flight.png").stat().st_size > 20_000
    replayed = guidance("replay", out / "record.mcap")
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr


@pytest.mark.slow
def test_ctrl_c_on_the_ground_ends_with_a_vehicle_that_is_disarmed_and_says_so(tmp_path):
    vehicle = {"name": "uav1", "flavour": "px4", "ready_after_s": 1.0, "parameters": FENCED["px4"]}
    with running([vehicle], over=["udp"]) as fleet:
        process = subprocess.Popen(
            [GUIDANCE, "fly", NEAR_FILE, "--vehicle", fleet["uav1"].udp, "--out", tmp_path / "out"],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert any("climbing" in line for line in process.stdout)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    assert process.returncode == 130, out + err
    assert "interrupted: the vehicle was told to land, and is landed" in out


def test_where_there_is_no_vehicle_it_is_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = guidance("fly", "--vehicle", "tcpout://127.0.0.1:9")
    assert done.returncode == 3
    assert "127.0.0.1:9" in done.stderr
