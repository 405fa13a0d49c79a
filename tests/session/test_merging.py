"""A scenario with a vehicle file: allowed combinations of the two files, authority to order, and one flight."""

import json
import math
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader

from guidance.clock import VirtualClock
from guidance.config import find, load, parse_document
from guidance.errors import ConfigError, FlightError
from guidance.flight import Event, State
from guidance.log import replay
from guidance.session.flight_files import recorded_settings
from guidance.session.fly.mission import PATIENCE_S, MissionPolicy
from guidance.session.fly.result import outcome_of_flight
from guidance.session.plan import merged, plan_of
from guidance.session.vehicle_file import Config
from guidance.sim.scenario import Scenario
from guidance.sim.scenario_file import load_scenario
from guidance.sim.stepped import SteppedWorld
from sitl_mock.child import running
from tests.harness.supervised import Supervised
from tests.harness.vehicle import SOON_UP_AND_DOWN

pytestmark = pytest.mark.usefixtures("soon_up_and_down")

GUIDANCE = Path(sys.executable).parent / "guidance"
DOCUMENT = {
    "name": "uav1",
    "vehicle": {"autopilot": "px4", "url": "udpin://127.0.0.1:14540"},
    "evader": {"kind": "global_position", "url": "udpin://127.0.0.1:14541", "system_id": 2},
    "game": {
        "speed_m_s": 6.0,
        "climb_m_s": 2.0,
        "descent_m_s": 1.5,
        "evader_speed_m_s": 3.0,
        "standoff_radius_m": 8.0,
        "standoff_height_m": 10.0,
    },
    "limits": {"floor_m": 5.0, "ceiling_m": 60.0, "fence_radius_m": 100.0},
    "preflight": {"fence_required": False},
}
CHASE = {
    "title": "a chase",
    "game": "pe",
    "pursuer": {
        "position_m": (0.0, 0.0, 14.0),
        "speed_m_s": 6.0,
        "speed_set": "cylinder",
        "takeoff_height_m": 14.0,
    },
    "evader": {"position_m": (6.0, 24.0), "speed_m_s": 3.0},
    "standoff": {"radius_m": 8.0, "height_m": 10.0, "tolerance_m": 1.0},
    "hold_s": 0.5,
}


def own(**sections):
    merged = {name: {**DOCUMENT.get(name, {}), **keys} for name, keys in sections.items()}
    return parse_document(Config, {**DOCUMENT, **merged}, source="vehicle")


def scenario(**sections):
    merged = {name: {**CHASE.get(name, {}), **keys} for name, keys in sections.items()}
    return parse_document(Scenario, {**CHASE, **merged}, source="scenario")


def supervised(config, flown, *, engage):
    """A daemon around the stepped mock; the evader stands still."""
    clock = VirtualClock()
    world = SteppedWorld(flown, clock)
    policy = MissionPolicy(engage, hand_over=Event.HOLD)
    return Supervised(clock, world, plan=plan_of(config, flown), scenario=flown, policy=policy)


@pytest.fixture
def sortie():
    made = []

    def make(config, flown, *, engage=True):
        made.append(supervised(config, flown, engage=engage))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_a_game_is_flown_and_the_vehicle_handed_over_as_its_file_says(sortie):
    """Catches a scenario that overrides how its vehicle's file ends a game."""
    flown = sortie(own(), scenario(evader={"position_m": (6.0, 40.0)})).run(120.0)
    outcome = outcome_of_flight(flown.result, "vehicle")
    assert (outcome.run, outcome.end) == ("vehicle", "captured")
    assert flown.daemon.finished
    assert flown.state is State.HOLDING
    # The evader stands where it is: the pursuer has only its own way to go, and a bound of 3 m/s to fear.
    assert outcome.achieved < outcome.predicted
    assert outcome.min_standoff_m > 7.0


def test_without_a_persons_word_nothing_starts_and_nothing_engages(sortie, monkeypatch):
    """Catches a scenario that starts a real vehicle without a person."""
    monkeypatch.setitem(PATIENCE_S, State.READY, 5.0)  # of 60, to fly less
    flown = sortie(own(), scenario(), engage=False).run(12.0)
    assert flown.state is State.READY
    flown.mailbox.ask("start")
    flown.run(60.0, until=lambda: flown.state is State.STANDING_BY)
    assert flown.run(6.0).state is State.STANDING_BY
    flown.mailbox.ask("engage")
    flown.run(60.0)
    assert outcome_of_flight(flown.result, "vehicle").end == "captured"


def test_a_game_over_its_time_is_handed_over_and_says_so(sortie):
    """Catches a game that goes on after its time."""
    flown = sortie(own(), scenario().model_copy(update={"time_limit_s": 1.0}))
    flown.run(120.0)
    outcome = outcome_of_flight(flown.result, "vehicle")
    assert (outcome.end, flown.state) == ("time_up", State.HOLDING)


def test_preflight_must_pass_and_what_it_wants_is_said(sortie):
    flown = sortie(own(preflight={"fence_required": True}), scenario())
    with pytest.raises(FlightError, match=r"preflight refuses: .*GF_MAX_HOR_DIST"):
        flown.run(60.0)
    assert flown.state is State.CHECKING


def test_a_start_outside_of_the_fence_about_home_is_refused_on_the_ground(sortie):
    somewhere = {"latitude_deg": 47.5, "longitude_deg": 8.545594, "altitude_amsl_m": 488.0}
    elsewhere = sortie(own(), scenario())
    elsewhere.daemon.exchange(lambda: plan_of(own(), scenario(site=somewhere)), 0.0)
    with pytest.raises(
        FlightError, match=r"pursuer.position_m is 11\d{3} m from the vehicle's home"
    ):
        elsewhere.run(60.0)


def test_limits_are_the_tighter_of_both_files():
    flown = scenario(limits={"fence_radius_m": 80.0, "ceiling_m": 100.0, "floor_m": 3.0})
    limits = merged(flown, own()).limits
    assert (limits.floor_m, limits.ceiling_m, limits.fence_radius_m) == (5.0, 60.0, 80.0)
    envelope = plan_of(own(), flown).flight.cycle.envelope
    assert (envelope.floor_m, envelope.ceiling_m, envelope.fence_radius_m) == (5.0, 60.0, 80.0)
    assert (envelope.climb_m_s, envelope.descent_m_s) == pytest.approx((2.2, 1.65))


def test_speed_limits_are_the_tighter_of_both_files_too():
    assert merged(scenario(), own()).limits.speed_m_s == pytest.approx(
        1.1 * scenario().pursuer.speed_m_s
    )
    tight = own(limits={"speed_m_s": 6.2}), scenario(limits={"speed_m_s": 7.0})
    assert merged(tight[1], tight[0]).limits.speed_m_s == 6.2


def test_a_library_scenario_flies_with_the_supplied_vehicle_file():
    config = load(Config, find("px4", "vehicles"))
    assert (
        plan_of(config, load_scenario("evader_turns")[1]).flight.cycle.game.evader_speed_m_s == 3.0
    )


@pytest.mark.parametrize(
    ("sections", "keys"),
    [
        (
            {"pursuer": {"autopilot": "arducopter"}},
            ("pursuer.autopilot = 'arducopter'", "vehicle.autopilot = 'px4'"),
        ),
        ({"pursuer": {"speed_m_s": 9.0}}, ("pursuer.speed_m_s = 9", "game.speed_m_s = 6")),
        (
            {"pursuer": {"descent_m_s": 2.5}},
            ("pursuer.descent_m_s = 2.5", "game.descent_m_s = 1.5"),
        ),
        ({"evader": {"speed_m_s": 1.0}}, ("evader.speed_m_s = 1", "game.evader_speed_m_s = 3")),
        (
            {"evader": {"speed_m_s": 3.5, "declared_speed_m_s": 2.0}},
            ("evader.declared_speed_m_s = 2", "game.evader_speed_m_s = 3"),
        ),
        ({"standoff": {"radius_m": 3.0}}, ("standoff.radius_m = 3", "game.standoff_radius_m = 8")),
        ({"standoff": {"height_m": 6.0}}, ("standoff.height_m = 6", "game.standoff_height_m = 10")),
        (
            {"pursuer": {"position_m": (0.0, 0.0, 70.0)}},
            ("pursuer.position_m", "limits.ceiling_m = 60"),
        ),
        (
            {"pursuer": {"takeoff_height_m": 3.0}},
            ("pursuer.takeoff_height_m", "limits.floor_m = 5"),
        ),
        (
            {"pursuer": {"position_m": (0.0, 150.0, 14.0)}},
            ("pursuer.position_m", "limits.fence_radius_m = 100"),
        ),
    ],
)
def test_values_that_contradict_each_other_are_refused_with_both_keys(sections, keys):
    with pytest.raises(ConfigError) as caught:
        merged(scenario(**sections), own())
    assert all(key in str(caught.value) for key in keys), caught.value
    assert len(str(caught.value).splitlines()) == 2


@pytest.mark.slow
def test_a_scenario_is_flown_over_udp_with_a_vehicle_file_and_its_record_replays(tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        control = probe.getsockname()[1]
    vehicles = [
        {"name": "uav1", "flavour": "px4", "system_id": 1, "ready_after_s": 0.5,
         "parameters": {**SOON_UP_AND_DOWN, "GF_MAX_HOR_DIST": 210.0, "GF_MAX_VER_DIST": 70.0}},
        {"name": "prey", "flavour": "rover", "system_id": 2, "ready_after_s": 0.5, "start_ned_m": [24.0, 8.0, 0.0]},
    ]  # fmt: skip
    with running(vehicles, over=["udp"]) as fleet:
        (tmp_path / "uav1.toml").write_text(
            f"""
name = "uav1"
vehicle = {{ autopilot = "px4", url = "{fleet["uav1"].udp}", connect_timeout_s = 10.0 }}
game = {{ speed_m_s = 6.0, climb_m_s = 2.0, descent_m_s = 1.5, evader_speed_m_s = 3.0, standoff_height_m = 10.0 }}
limits = {{ ceiling_m = 60.0, fence_radius_m = 200.0 }}
control = {{ endpoint = "tcp/127.0.0.1:{control}" }}
[evader]
kind = "global_position"
url = "{fleet["prey"].udp}"
system_id = 2
request_rate_hz = 20.0
"""
        )
        command = [
            GUIDANCE,
            "scenario",
            "run",
            "evader_turns",
            "--as",
            "vehicle",
            "--engage",
            "--yes",
        ]
        command += [
            "--config",
            tmp_path / "uav1.toml",
            "--out",
            tmp_path,
        ]
        done = subprocess.run(command, capture_output=True, text=True, timeout=150, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    row = json.loads((tmp_path / "outcome.json").read_text())
    assert (row["run"], row["end"]) == ("vehicle", "captured")
    assert row["evader_policy"] == "reported"  # the policy of the scenario file is not used here
    assert row["min_standoff_m"] > 7.0
    assert math.isfinite(row["predicted_capture_time_s"])
    record = tmp_path / "record.mcap"
    with record.open("rb") as stream:
        assert make_reader(stream).get_summary().statistics.message_count > 1000
    for step in replay(record, recorded_settings):
        assert str(step.outputs.state) == step.row.state, step.row.now_s
