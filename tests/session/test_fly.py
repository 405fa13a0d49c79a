"""Whole flights in virtual time: the real core and the real mock, whole MAVLink frames between them, no sleeping."""

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader

from guidance.flight import Event, State
from guidance.frames import Enu
from guidance.log import survey_of
from guidance.log.entries import CYCLE, EVENT
from guidance.log.scene import isochron
from guidance.session.flight_files import flight_folder
from guidance.session.fly.result import ending_words, outcome_of_flight
from guidance.sim.batch import game
from guidance.sim.scenario_file import load_scenario
from tests.harness.flights import NEAR, flown

pytestmark = [pytest.mark.flight, pytest.mark.usefixtures("soon_up_and_down")]


def outcome(result):
    return outcome_of_flight(result, "fast")


def ended(result):
    return ending_words(outcome(result))


@pytest.fixture(scope="module")
def pe(tmp_path_factory, soon_up_and_down):
    path = tmp_path_factory.mktemp("pe") / "record.mcap"
    return flown(load_scenario("pe")[1], path), path


def test_a_full_disk_is_reported_at_once_and_the_game_is_played_to_its_end(tmp_path):
    scenario = Path(__file__).parents[1] / "data" / "near_chase.toml"
    guidance = Path(sys.executable).parent / "guidance"
    # No file of the process may become larger than 100 blocks of 1 KiB: the record alone would.
    command = f'ulimit -f 100; exec "{guidance}" fly "{scenario}" --fast --out "{tmp_path}"'
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 5, done.stderr
    assert done.stdout.count("recording stopped at") == 2
    assert "File too large" in done.stdout
    assert "captured" in done.stdout
    assert "cannot be written" in done.stdout  # the picture, too, has no room
    assert "not recorded whole" in done.stderr
    assert (tmp_path / "record.mcap").stat().st_size == 100 * 1024
    assert survey_of(tmp_path / "record.mcap").faults
    assert not (tmp_path / "flight.png").exists()
    assert all(file.stat().st_size > 0 for file in tmp_path.iterdir())


@pytest.fixture(scope="module")
def tad(soon_up_and_down):
    return flown(load_scenario("tad")[1])


@pytest.mark.parametrize("name", ["pe", "tad"])
def test_what_the_papers_scenarios_expect_holds_in_flight(name, pe, tad):
    result = {"pe": pe[0], "tad": tad}[name]
    verdicts = list(load_scenario(name)[1].expect.verdicts(outcome(result)._asdict()))
    assert verdicts
    assert [verdict for verdict in verdicts if not verdict.held] == []


def test_the_papers_pe_game_is_flown_within_15_percent_of_its_value(pe):
    result, _ = pe
    assert ended(result) == "captured"
    assert result.ended is State.LANDED
    assert 0.85 < outcome(result).ratio < 1.15
    assert result.late_cycles == 0


def test_the_predicted_value_is_the_closed_form_of_the_stand_off_game(pe):
    result, _ = pe
    x, y, z = result.engaged.pursuer_game_m
    d = math.dist((x, y), result.engaged.evader_game_m[:2]) - 3.0
    v = 1.5
    # A flight's speed set is a cylinder: 3 m/s over the ground and 2 m/s down, both at once.
    closed_form = d / (3.0 - v)
    assert (z - 5.0) / 2.0 < closed_form
    # Slightly more, because the evader's position is some 0.01 s old and the evader may have moved since.
    assert closed_form <= result.engaged.value <= closed_form + 0.1
    # The outcome's is to where the disc counts as reached, 0.5 m before it, from a pursuer that knows all.
    assert outcome(result).predicted == pytest.approx(closed_form - 0.5 / (3.0 - v), abs=1e-6)


def test_the_papers_tad_game_ends_about_as_far_from_the_target_as_its_value(tad):
    assert ended(tad) == "captured"
    assert outcome(tad).achieved == pytest.approx(outcome(tad).predicted, rel=0.15)


def test_the_flight_went_through_every_phase_in_order(pe):
    result, _ = pe
    changes = [
        transition.after
        for transition in result.transitions
        if transition.after is not transition.before
    ]
    assert changes == [
        State.CHECKING,
        State.READY,
        State.ARMING,
        State.CLIMBING,
        State.POSITIONING,
        State.STANDING_BY,
        State.ENTERING,
        State.ENGAGED,
        State.ON_STATION,
        State.LANDING,
        State.LANDED,
    ]


def test_the_pursuer_stays_above_the_stand_off_height_until_it_lands(pe):
    result, _ = pe
    heights = [
        sample.pursuer_m[2]
        for sample in result.samples
        if sample.state in (State.ENGAGED, State.ON_STATION)
    ]
    assert min(heights) > 5.0 - 1.0


def test_the_record_holds_every_cycle_every_frame_and_every_event(pe):
    result, path = pe
    with path.open("rb") as stream:
        reader = make_reader(stream)
        counts = {}
        setpoints = 0
        for _, channel, message in reader.iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if channel.topic == CYCLE.topic:
                setpoints += "setpoint" in json.loads(message.data)
    assert counts[CYCLE.topic] == result.cycles
    # One begins the flight
    assert counts[EVENT.topic] == 1 + len(result.transitions) + len(result.alarms)
    assert setpoints == result.setpoints_sent
    assert counts["pursuer/mavlink_raw/in"] >= result.setpoints_sent
    assert counts["pursuer/mavlink_raw/out"] > 100 * result.duration_s


def test_one_setpoint_goes_out_a_cycle_and_none_outside_of_the_guided_states(pe):
    _, path = pe
    with path.open("rb") as stream:
        rows = [
            json.loads(message.data)
            for _, _, message in make_reader(stream).iter_messages(topics=[CYCLE.topic])
        ]
    guided = {"entering", "engaged", "paused", "on station"}
    assert all("setpoint" in row for row in rows if row["state"] in guided)
    silent = [
        row for row in rows if row["state"] not in guided | {"holding", "landing", "returning"}
    ]
    assert len(silent) > 100
    assert not any("setpoint" in row for row in silent)


@pytest.fixture(scope="module")
def near(tmp_path_factory, soon_up_and_down):
    """A short flight: its result, its record, and what the live line was told."""
    path = tmp_path_factory.mktemp("near") / "record.mcap"
    seen = []
    return flown(NEAR, path, seen.append), path, seen


def test_two_runs_with_one_seed_are_one_record_and_another_seed_is_another(tmp_path, near):
    first, record, _ = near
    flown(NEAR, tmp_path / "again.mcap")
    other = flown(NEAR.model_copy(update={"seed": 7, "time_limit_s": 1.0}))
    assert record.read_bytes() == (tmp_path / "again.mcap").read_bytes()
    places, others = ([sample.pursuer_m for sample in one.samples[:400]] for one in (first, other))
    assert places != others


def test_arducopter_flies_the_same_scenario():
    pursuer = NEAR.pursuer.model_copy(update={"autopilot": "arducopter"})
    result = flown(NEAR.model_copy(update={"pursuer": pursuer}))
    assert ended(result) == "captured"
    assert result.ended is State.LANDED


def test_a_game_that_lasts_too_long_is_ended_by_landing():
    result = flown(NEAR.model_copy(update={"time_limit_s": 3.0}))
    assert ended(result) == "time limit reached"
    assert result.ended is State.LANDED
    assert Event.LAND in {transition.event for transition in result.transitions}


def test_the_live_line_is_told_about_ten_times_a_second(near):
    result, _, seen = near
    assert result.cycles / 6 < len(seen) < result.cycles / 5
    engaged = [progress for progress in seen if progress.state is State.ENGAGED]
    assert all(
        progress.certificate is not None and progress.mode == "OFFBOARD" for progress in engaged
    )


def test_on_the_isochron_both_players_arrive_at_once():
    scenario = load_scenario("pe")[1]
    standoff = game(scenario).standoff
    P = Enu((40.0, 7.1, 47.05))
    E = Enu((39.6, 48.0, 0.0))
    for x, y in isochron(game(scenario), P, E, points=25):
        evader_s = math.hypot(x - E[0], y - E[1]) / 1.5
        ground = max(0.0, math.hypot(x - P[0], y - P[1]) - standoff.radius_m)
        # A flight's speed set is a cylinder: 3 m/s over the ground and 2 m/s down, both at once.
        pursuer_s = max(ground / 3.0, (P[2] - standoff.height_m) / 2.0)
        assert pursuer_s == pytest.approx(evader_s, rel=1e-6)


def test_two_flights_at_once_have_a_folder_each_and_an_empty_one_goes(tmp_path):
    with flight_folder(None, "pe", tmp_path) as one, flight_folder(None, "pe", tmp_path) as other:
        assert (one, other) == (tmp_path / "pe-001", tmp_path / "pe-002")
        (other / "record.mcap").write_text("a record")
    assert [path.name for path in tmp_path.iterdir()] == ["pe-002"]
    with flight_folder(None, "pe", tmp_path) as again:
        assert again == tmp_path / "pe-001"
