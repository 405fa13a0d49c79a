"""Scenario files of teams: read, refused, played as mathematics, shown."""

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.config import parse_document
from guidance.errors import ConfigError, OutputError
from guidance.game import Ball, Extent, Game, Winner, solve
from guidance.game.team import match_teams
from guidance.sim.scenario_file import load_any, load_scenario
from guidance.sim.teams import TeamScenario, opening_of, play_teams, summary_of, teams_of

TAD: dict[str, Any] = {
    "title": "two on two",
    "game": "tad",
    "target": {"position_m": [0.0, 0.0]},
    "step_s": 0.3,
    "pursuer": [
        {"position_m": [6.0, 4.0, 5.0], "speed_m_s": 2.0},
        {"position_m": [-6.0, -5.0, 3.0], "speed_m_s": 2.5},
    ],
    "evader": [
        {"position_m": [12.0, 0.0], "speed_m_s": 1.0},
        {"position_m": [-14.0, 1.0], "speed_m_s": 0.8},
    ],
}
PE = {key: value for key, value in TAD.items() if key != "target"} | {"game": "pe"}


def built(document=TAD, **keys):
    return parse_document(TeamScenario, {**document, **keys}, source="a.toml")


def written(tmp_path, name="a.toml", extra=""):
    text = """title = "two on one"
game = "tad"
target = { position_m = [0.0, 0.0] }
pursuer = [{ position_m = [6.0, 4.0, 5.0], speed_m_s = 2.0 }, { position_m = [6.0, -5.0, 3.0], speed_m_s = 2.0 }]
evader = [{ position_m = [9.0, 0.0], speed_m_s = 1.0 }]
"""
    path = tmp_path / name
    path.write_text(text + extra)
    return path


def guidance(*arguments):
    return CliRunner().invoke(app, ["scenario", *map(str, arguments)], env={"COLUMNS": "200"})


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"pursuer": []}, "pursuer"),
        ({"pursuer": [{"position_m": [0, 0, 5], "speed_m_s": 1.0}]}, r"1 / 1: must be above 1"),
        (
            {"pursuer": [{"position_m": [0, 0, -5], "speed_m_s": 9.0}]},
            r"position_m\.2 = -5: must be greater",
        ),
        (
            {"pursuer": [{"position_m": [0, 0, 5], "speed_m_s": 9.0, "policy": "clever"}]},
            r"pursuer\[0\].policy = 'clever'",
        ),
        (
            {"evader": [{"position_m": [0, 0], "speed_m_s": 1.0, "count": 3}]},
            "scatter_m: missing; count = 3",
        ),
        ({"evader": [{"position_m": [0, 0], "speed_m_s": 1.0, "count": 0}]}, "count"),
        ({"evader": [{"position_m": [0, 0, 1], "speed_m_s": 1.0}]}, "position_m"),
        ({"evader": [{"position_m": [0, 0], "speed_m_s": 1.0, "speed": 1}]}, "did you mean"),
        ({"target": None}, 'game = "tad" needs a target'),
        ({"game": "pe"}, "not allowed with game"),
        ({"standoff": {}}, "standoff: unknown key"),
    ],
)
def test_a_wrong_file_is_refused_by_its_key(keys, said):
    with pytest.raises(ConfigError, match=said):
        built(**keys)


def test_an_evader_without_a_target_cannot_head_for_it():
    with pytest.raises(ConfigError, match=r"evader\[1\].policy = 'task_oriented': needs target"):
        built(PE, evader=[PE["evader"][0], {**PE["evader"][1], "policy": "task_oriented"}])


def test_every_evader_has_a_row_that_holds_what_the_matching_promised():
    scenario = built()
    rows = play_teams([scenario])[0]
    P = np.array([one["position_m"] for one in TAD["pursuer"]])
    E = np.array([[*one["position_m"], 0.0] for one in TAD["evader"]])
    game = Game(Ball(np.array([[2.0], [2.5]])), np.array([1.0, 0.8]))
    known = match_teams(game, P, E, np.zeros(3))
    assert [row.evader for row in rows] == [0, 1]
    assert [row.predicted for row in rows] == known.value.tolist()
    assert [row.first for row in rows] == [row.captor for row in rows] == known.first.tolist()
    for row in rows:
        assert (row.end, row.winner, row.predicted_winner) == ("captured", "pursuer", "pursuer")
        assert row.achieved == row.evader_to_target_m == pytest.approx(row.predicted, abs=1e-6)
        assert row.regret == pytest.approx(0.0, abs=1e-6)
        assert row.ratio == pytest.approx(1.0, abs=1e-6)
        assert row.capture_time_s == row.game_time_s
        assert (row.pursuers, row.evaders, row.guaranteed, row.captured) == (2, 2, 2, 2)
    summary = summary_of(rows)
    assert summary["total"] == pytest.approx(float(known.total))
    assert summary["worst_regret"] == max(row.regret for row in rows)


def test_pe_is_held_against_the_time_that_is_guaranteed():
    """Catches a regret of a chase by teams that is taken from another bound."""
    rows = play_teams([built(PE)])[0]
    for row in rows:
        assert row.lower_bound - 1e-6 <= row.achieved <= row.predicted + 1e-6
        assert row.regret == row.achieved - row.predicted
        assert math.isnan(row.evader_to_target_m)


def test_who_is_not_matched_may_arrive_and_has_no_regret():
    near = {"position_m": [-5.0, 1.0], "speed_m_s": 1.0}
    rows = play_teams([built(pursuer=TAD["pursuer"][:1], evader=[TAD["evader"][0], near])])[0]
    lost = next(row for row in rows if row.first == -1)
    assert (lost.end, lost.winner, lost.predicted_winner) == ("arrived", "evader", "evader")
    assert (lost.achieved, lost.predicted, lost.captor) == (0.0, 0.0, -1)
    assert math.isnan(lost.regret)
    assert math.isnan(lost.ratio)
    over = play_teams([built(time_limit_s=0.5)])[0]
    assert [(row.end, row.winner) for row in over] == [("time_up", "none")] * 2
    assert all(math.isnan(row.achieved) for row in over)
    assert math.isnan(summary_of(over)["worst_regret"])


def test_games_side_by_side_are_those_alone():
    """Catches a scenario of teams that is played with the settings of the one beside it."""
    evaders = [{**TAD["evader"][0], "count": 2, "scatter_m": 5.0}]
    many = [built(evader=evaders, seed=seed) for seed in range(3)]
    mixed = [many[0], built(PE), *many[1:], built(hysteresis=1.0)]
    alone = [play_teams([one])[0] for one in mixed]
    for rows, single in zip(play_teams(mixed), alone, strict=True):
        assert [str(row) for row in rows] == [str(row) for row in single]


def test_more_players_of_a_table_leave_the_others_where_they_are():
    def places(count, seed=0):
        return teams_of(
            built(seed=seed, evader=[{**TAD["evader"][0], "count": count, "scatter_m": 5.0}])
        ).evaders_m

    np.testing.assert_array_equal(places(2), places(6)[:2])
    assert (np.linalg.norm(places(50) - [12.0, 0.0, 0.0], axis=1) <= 5.0).all()
    assert (places(2, seed=1) != places(2)).any()
    assert teams_of(built()).pursuers_m.tolist() == [one["position_m"] for one in TAD["pursuer"]]


def test_policies_are_played():
    """Catches a policy of a scenario of teams that is read and not played."""
    straight = play_teams(
        [built(evader=[{**one, "policy": "task_oriented"} for one in TAD["evader"]])]
    )[0]
    assert all(row.evader_policy == "task_oriented" for row in straight)
    assert all(row.regret < -1e-3 for row in straight)
    chased = play_teams(
        [built(pursuer=[{**one, "policy": "pure_pursuit"} for one in TAD["pursuer"]])]
    )[0]
    assert all(row.pursuer_policy == "pure_pursuit" for row in chased)
    assert chased[0].regret > 0.1


def test_the_command_prints_a_row_for_each_evader_and_writes_them(tmp_path):
    """Catches a command that leaves out an evader, or passes when an expectation fails."""
    path = written(tmp_path, extra="[expect]\nguaranteed = { min = 1 }\n")
    done = guidance("run", path, "--out", tmp_path, "--seed", "4")
    assert done.exit_code == 0, done.output
    lines = [line.split() for line in done.output.splitlines()]
    assert {"uav1", "uav2", "rover1"} <= {line[0] for line in lines if line}
    assert ["tad", "2", "1", "1", "1"] in [line[:5] for line in lines]
    assert "holds" in done.output
    rows = json.loads((tmp_path / "outcome.json").read_text())
    assert rows[0]["end"] == "captured"
    assert rows[0]["seed"] == 4
    assert rows[0]["predicted"] == pytest.approx(5.95335625)
    failing = guidance("run", written(tmp_path, "b.toml", "[expect]\ncaptured = { max = 0 }\n"))
    assert failing.exit_code == 1
    assert "FAILS" in failing.output
    assert guidance("run", written(tmp_path, "c.toml")).exit_code == 0


def test_a_team_that_cannot_fly_is_refused_with_the_vehicle_and_the_key(tmp_path):
    done = guidance("run", written(tmp_path), "--as", "vehicle", "--config", "px4")
    assert isinstance(done.exception, ConfigError)
    assert "a team needs --vehicle URL for each of its vehicles" in str(done.exception)
    done = guidance("run", tmp_path / "a.toml", "--as", "fast")
    assert isinstance(done.exception, ConfigError)
    assert re.search(
        r"uav\d in flight:\n.*pursuer\.position_m: height 3 m; allowed is", str(done.exception)
    )
    with pytest.raises(
        ConfigError, match=r"has teams, which this command does not play: guidance scenario run"
    ):
        load_scenario(str(tmp_path / "a.toml"))


def test_show_explains_teams_and_draws_them(tmp_path):
    """Catches a scenario of teams that cannot be shown."""
    done = guidance("show", "teams_breakthrough", "--out", tmp_path / "a.png")
    assert done.exit_code == 0, done.output
    assert "target-attacker-defender, of teams" in done.output
    assert "6 at (45, 0) m, scattered over 28 m, 1.5 m/s, plays task_oriented" in done.output
    first = opening_of(load_any("teams_breakthrough")[1])
    assert (
        f"{int(first.guaranteed)} captures guaranteed, {float(first.total):.2f} m from the target"
        in done.output
    )
    assert (tmp_path / "a.png").stat().st_size > 40_000


def test_pe_of_teams_is_drawn_and_a_picture_that_cannot_be_written_is_said(tmp_path):
    """Catches a chase by teams that cannot be drawn, without a target."""
    from guidance.viz.figures import draw_teams

    draw_teams(built(PE), tmp_path / "pe.png")
    assert (tmp_path / "pe.png").stat().st_size > 30_000
    with pytest.raises(OutputError, match=r"/nowhere/pe\.png: cannot be written"):
        draw_teams(built(PE), Path("/nowhere/pe.png"))


def test_the_region_that_is_drawn_is_what_the_evader_reaches_first():
    from guidance.viz.figures import region

    scenario = built()
    teams = teams_of(scenario)
    for team in ([0], [0, 1]):
        edge = region(scenario, team, 0, points=90)
        run = np.linalg.norm(edge - teams.evaders_m[0, :2], axis=1) / teams.evader_speed_m_s[0]
        flown = [
            np.linalg.norm(np.column_stack([edge, np.zeros(90)]) - teams.pursuers_m[i], axis=1)
            / teams.pursuer_speed_m_s[i]
            for i in team
        ]
        np.testing.assert_allclose(run, np.min(flown, axis=0), rtol=1e-9)
    alone = solve(Game(Ball(2.0), 1.0), teams.pursuers_m[0], teams.evaders_m[0]).value
    assert np.linalg.norm(
        region(scenario, [0], 0) - teams.evaders_m[0, :2], axis=1
    ).max() == pytest.approx(alone, rel=1e-4)


SQUARE = {
    "position_m": [0.0, 0.0],
    "polygon_m": [[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]],
}
AT_THE_EDGE = {
    "title": "one against one at a square",
    "game": "tad",
    "target": SQUARE,
    "pursuer": [{"position_m": [0.0, 0.0, 15.0], "speed_m_s": 6.0}],
    "evader": [{"position_m": [47.0, 0.0], "speed_m_s": 2.5}],
}


def test_a_team_defends_the_targets_shape_and_promises_what_one_pursuer_would():
    scenario = built(AT_THE_EDGE)
    shape = Extent(tuple(map(tuple, SQUARE["polygon_m"])))
    alone = solve(Game(Ball(6.0), 2.5, target_extent=shape), [0, 0, 15], [47, 0, 0], [0, 0, 0])
    assert alone.winner == Winner.EVADER
    assert opening_of(scenario).guaranteed == 0
    (row,) = play_teams([scenario])[0]
    assert (row.guaranteed, row.predicted_winner, row.end) == (0, "evader", "arrived")
    assert row.game_time_s == pytest.approx((47.0 - 40.0) / 2.5, abs=1e-6)
    assert row.evader_to_target_m == pytest.approx(0.0, abs=1e-6)


def test_the_distance_that_a_team_promises_and_takes_is_that_of_the_shape():
    """Catches a target's shape that a team's promise or outcome ignores."""
    round_target = {"position_m": [0.0, 0.0], "radius_m": 5.0}
    point = play_teams([built()])[0][0]
    disc = play_teams([built(target=round_target)])[0][0]
    for row in (point, disc):
        assert row.end == "captured"
        assert row.evader_to_target_m == pytest.approx(row.predicted, abs=0.05)
    assert disc.predicted == pytest.approx(point.predicted - 5.0, abs=1e-9)


def test_two_scenarios_that_differ_in_their_targets_shape_are_played_each_by_itself():
    """Catches two target shapes in one batch."""
    both = play_teams([built(AT_THE_EDGE), built({**AT_THE_EDGE, "target": TAD["target"]})])
    assert [rows[0].end for rows in both] == ["arrived", "captured"]
