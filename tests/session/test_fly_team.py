"""A team flight in virtual time: from take-off to landing, with whole MAVLink frames and the team's messages."""

import math
from copy import copy

import pytest

from guidance.config import parse_document
from guidance.flight import Event, State
from guidance.log.reader import cycles_of
from guidance.session import recorded_flight
from guidance.session.fly.mission import Mission
from guidance.session.fly.result import distance_to_target_m, team_rows
from guidance.session.observe import outputs
from guidance.session.open.mock import MockOptions
from guidance.session.open.opened import NOBODY, Onlooker
from guidance.session.recorded_flight import fly_recorded
from guidance.sim.team_flight import pursuits_of_team
from guidance.sim.teams import TeamScenario
from guidance.viz import report
from guidance.viz.history import captures_of, team_history, team_opening_words, team_summary
from guidance.viz.panel.snapshot import replay_of
from tests.harness.flights import LOW_M, low_team
from tests.harness.witness import Witness
from tests.team.lossy import LossyNetwork

pytestmark = pytest.mark.usefixtures("soon_up_and_down")
ROUND = {"position_m": [0.0, 0.0], "radius_m": 6.0}


def evaders(speed_m_s, *places_m):
    """Return evaders nearer than the scenario's, for a shorter flight."""
    return [{"position_m": place, "speed_m_s": speed_m_s} for place in places_m]


GUARD = low_team("teams_guard", target=ROUND, evader=evaders(3.0, [36, 7], [-24, 27]))


PAIRS = parse_document(
    TeamScenario,
    {
        "title": "Two against two",
        "game": "tad",
        "seed": 1,
        "pursuer": [
            {"position_m": [0, 0, 4], "speed_m_s": 7},
            {"position_m": [20, 0, 9], "speed_m_s": 7},
        ],
        "evader": evaders(3.0, [20, 60], [-20, 60]),
        "target": {"position_m": [0, 0]},
        "flight": {
            "separation_m": 8,
            "separation_height_m": 3,
            "takeoff_height_m": 4,
            "standoff": {"radius_m": 5, "height_m": 3},
        },
    },
    source="two against two",
)


class UntilCaptured(Mission):
    """A mission that ends as soon as every vehicle has been on station."""

    @property
    def finished(self):
        return super().finished or all(
            any(transition.event is Event.CAPTURED for transition in vehicle.transitions)
            for vehicle in self.result.vehicles.values()
        )


def captured(scenario, onlooker=NOBODY):
    """Fly a team until the captures."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded_flight, "Mission", UntilCaptured)
        return fly_recorded(scenario, None, MockOptions(fast=True), onlooker)


@pytest.fixture(scope="module")
def guard(tmp_path_factory, soon_up_and_down):
    """Three vehicles against two evaders, with a record of each vehicle, and an output from outside."""
    folder = tmp_path_factory.mktemp("guard")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(outputs, "OUTPUTS", copy(outputs.OUTPUTS))
        witnesses = []
        outputs.OUTPUTS.add(
            "witness", lambda order: witnesses.append(Witness(order)) or witnesses[-1]
        )
        flown = fly_recorded(GUARD, folder, MockOptions(fast=True))
    return flown, folder, {witness.order.vehicle: witness for witness in witnesses}


@pytest.mark.flight
def test_an_output_from_outside_sees_every_vehicle_of_a_team(guard):
    flown, _, witnesses = guard
    assert sorted(witnesses) == sorted(flown.vehicles)
    for vehicle, witness in witnesses.items():
        witness.saw_the_whole(flown.vehicles[vehicle])


@pytest.fixture(scope="module")
def history(guard):
    """Return what the vehicles' records tell together."""
    flown, folder, _ = guard
    return team_history({name: folder / name / "record.mcap" for name in flown.vehicles})


@pytest.mark.flight
def test_the_team_captures_what_it_guarantees_and_lands(guard):
    flown, _, _ = guard
    rows = team_rows(GUARD, "fast", flown)
    assert [row.end for row in rows] == ["captured", "captured"]
    assert {row.guaranteed for row in rows} == {2}
    assert {vehicle.ended for vehicle in flown.vehicles.values()} == {State.LANDED}
    # The distance of a capture from the target is at least nine tenths of what was promised
    for row in rows:
        assert row.ratio > 0.9


@pytest.mark.flight
def test_nobody_arms_before_all_are_ready_and_nobody_engages_before_all_stand_by(guard):
    flown, _, _ = guard
    times = {
        event: [
            transition.now_s
            for vehicle in flown.vehicles.values()
            for transition in vehicle.transitions
            if transition.event is event
        ]
        for event in (Event.FIT, Event.START, Event.AT_START, Event.ENGAGE)
    }
    assert max(times[Event.FIT]) <= min(times[Event.START])
    assert max(times[Event.AT_START]) <= min(times[Event.ENGAGE])


@pytest.mark.flight
def test_the_separation_is_kept(guard):
    flown, _, _ = guard
    assert (
        flown.least_distance_m(GUARD.flight.separation_height_m) > GUARD.flight.separation_m - 0.5
    )


@pytest.mark.flight
def test_one_vehicle_coordinates_and_no_promise_is_lost_without_a_cause(guard):
    flown, _, _ = guard
    boards = [member.board for member in flown.members.values()]
    assert {(board.roles.vehicle, board.roles.term) for board in boards} == {("uav1", 1)}
    assert all(set(board.over) == {"rover1", "rover2"} for board in boards)
    promises = {promise.evader: promise for promise in boards[0].roles.promises}
    assert set(promises) == {"rover1", "rover2"}
    assert all(promise.value is not None or promise.cause for promise in promises.values())
    assert not any(board.counts["unmatched"] or board.news for board in boards)


@pytest.mark.flight
def test_every_vehicle_replays_bit_for_bit_with_its_mates_and_roles(guard, history):
    flown, folder, _ = guard
    for pursuit in pursuits_of_team(GUARD):
        path = folder / pursuit.vehicle / "record.mcap"
        rows = list(cycles_of(path))
        assert any(row.inputs.mates for row in rows)
        assert [row.inputs.role.evader for row in rows if row.inputs.role is not None]
        comparison = history.replays[pursuit.vehicle]
        sent = flown.vehicles[pursuit.vehicle].setpoints_sent
        assert (comparison.differing, comparison.setpoints) == (0, sent)


@pytest.mark.flight
def test_one_report_tells_the_flight_of_the_whole_team(guard, history, tmp_path, monkeypatch):
    flown, folder, _ = guard
    assert history.evaders == ["rover1", "rover2"]
    for name, evader in flown.evaders.items():
        capture = history.captures[name]
        assert (capture.vehicle, capture.now_s) == (evader.capture.vehicle, evader.capture.now_s)
        assert "; kept: " in history.verdict(name)
    assert [name for name, _ in team_summary(history)] == [
        "uav1",
        "uav2",
        "uav3",
        "rover1",
        "rover2",
    ]
    words = team_opening_words(history)
    assert "promised 2 captures; 2 promises were kept" in words
    assert f"{flown.least_distance_m(3.0):.1f} m apart" in words
    assert "replays bit for bit" in words
    records = {name: folder / name / "record.mcap" for name in flown.vehicles}
    told = []
    monkeypatch.setattr(report, "team_history", lambda paths: told.append(paths) or history)
    page, picture = report.write_team_report(records, tmp_path)
    assert told == [records]
    assert picture.name == "plan.png"
    assert words in page.read_text(encoding="utf-8")


@pytest.mark.flight
def test_the_replay_of_one_vehicle_has_all_vehicles_of_the_flight(guard, tmp_path):
    _, folder, _ = guard
    replay = replay_of(folder / "uav3" / "record.mcap")
    assert (replay["vehicle"], [mate["vehicle"] for mate in replay["mates"]]) == (
        "uav3",
        ["uav1", "uav2"],
    )
    assert replay["frames"][-1]["against"] == "rover2"
    for mate in replay["mates"]:
        assert mate["frames"][-1]["now_s"] == pytest.approx(replay["frames"][-1]["now_s"], abs=0.2)
    for name in ("uav1", "uav2"):
        (tmp_path / name).mkdir()
    (tmp_path / "uav1" / "record.mcap").write_bytes((folder / "uav1" / "record.mcap").read_bytes())
    (tmp_path / "uav2" / "record.mcap").write_text("no record")
    (mate,) = replay_of(tmp_path / "uav1" / "record.mcap")["mates"]
    assert "not an MCAP file" in mate["error"]


@pytest.mark.flight
def test_a_broken_promise_is_told_with_its_cause(history):
    lost = history.promised["rover1"].model_copy(update={"cause": "vehicle lost"})
    missed = history._replace(captures={}, promised={"rover1": lost})
    assert missed.verdict("rover1").endswith("not captured; broken: vehicle lost")
    assert missed.verdict("rover2") == "no capture could be promised; not captured"


@pytest.mark.flight
def test_pairings_of_equal_value_are_flown_without_crossing_and_keep_their_promises():
    """The vehicle that stands by first once took the crossed pairing, and giving way cost the promise."""
    flown = captured(PAIRS)
    rows = team_rows(PAIRS, "fast", flown)
    assert {row.evader: row.first for row in rows} == {0: 1, 1: 0}
    assert all(row.end == "captured" and row.ratio >= 1.0 for row in rows)


@pytest.mark.flight
def test_a_team_flies_pursuit_evasion_and_vehicles_at_one_evader_are_stacked():
    pursuers = [
        {"position_m": [-8.0, 12.0, LOW_M], "speed_m_s": 6.0},
        {"position_m": [-8.0, -12.0, LOW_M], "speed_m_s": 6.0},
    ]
    chase = low_team("teams_chase", pursuer=pursuers, evader=evaders(2.0, [-38, 31]))
    flown = captured(chase)
    for row in team_rows(chase, "fast", flown):
        assert (row.end, row.winner) == ("captured", "pursuer")
        assert row.ratio <= 1.1
    stations = {
        name: [sample.pursuer_m for sample in result.samples if sample.state is State.ON_STATION][
            -1
        ]
        for name, result in flown.vehicles.items()
    }
    one, other = stations.values()
    assert math.dist(one[:2], other[:2]) < chase.flight.separation_m
    assert abs(one[2] - other[2]) > chase.flight.separation_height_m
    assert (
        flown.least_distance_m(chase.flight.separation_height_m) > chase.flight.separation_m - 0.5
    )


@pytest.mark.flight
def test_a_coordinator_cut_off_for_three_seconds_costs_neither_separation_nor_captures(monkeypatch):
    networks = []
    engaged_s = []

    def joined(name, _, clock):
        if not networks:
            networks.append(LossyNetwork(clock, delay_s=0.05, jitter_s=0.05, loss=0.3, seed=1))
        return networks[0].join(name)

    monkeypatch.setattr(recorded_flight, "MemoryTransport", joined)

    def cut(progress):
        if progress.state is State.ENGAGED and not engaged_s:
            engaged_s.append(progress.now_s)
        since_s = progress.now_s - engaged_s[0] if engaged_s else 0.0
        networks[0].cut = {"uav1"} if 1.0 <= since_s < 4.0 else set()

    flown = captured(PAIRS, Onlooker(cut))
    assert [row.end for row in team_rows(PAIRS, "fast", flown)] == ["captured", "captured"]
    assert (
        flown.least_distance_m(PAIRS.flight.separation_height_m) > PAIRS.flight.separation_m - 0.5
    )
    boards = [member.board for member in flown.members.values()]
    assert len({(board.roles.vehicle, board.roles.term) for board in boards}) == 1
    assert boards[0].roles.term >= 2
    assert all(promise.value is not None or promise.cause for promise in boards[0].roles.promises)


@pytest.mark.flight
def test_terminal_and_report_have_one_distance_to_a_targets_shape_and_one_captor(guard, history):
    flown, _, _ = guard
    cycle = flown.vehicles["uav1"].cycle
    assert cycle.game.target_extent.radius_m == 6.0
    names = list(flown.vehicles)
    for row, evader in zip(team_rows(GUARD, "fast", flown), history.evaders, strict=True):
        capture = history.captures[evader]
        assert capture.vehicle == names[row.captor]
        assert distance_to_target_m(cycle, capture.evader_m) == row.evader_to_target_m
        assert f"{row.evader_to_target_m:.1f} m from the target" in history.verdict(evader)
        apart_m = math.hypot(*capture.evader_m[:2])
        assert row.evader_to_target_m == pytest.approx(apart_m - 6.0, abs=1e-9)


@pytest.mark.flight
def test_the_first_capture_of_an_evader_counts_whichever_record_is_read_first(history):
    first = history.captures["rover1"]
    flight = history.flights[first.vehicle]
    later = [event._replace(now_s=event.now_s + 2.0) for event in flight.events]
    late = flight._replace(events=later)
    captures = captures_of({"a": late, "b": flight})
    assert captures["rover1"] == first._replace(vehicle="b")
