"""Sweeps over games of teams: over numbers of players, a row for each evader."""

import json

import numpy as np
import pytest
from pyarrow import parquet

from guidance.errors import ConfigError
from guidance.sim.scenario_file import load_any
from guidance.sim.teams import play_teams, summary_of
from guidance.sweeps.compare import compare_sweeps
from guidance.sweeps.folder import begin_or_continue, read_folder
from guidance.sweeps.report import write_sweep_report
from guidance.sweeps.rows import planned, scenarios_of
from guidance.sweeps.running import finish

SCENARIO = """
title = "Short"
game = "tad"
target = { position_m = [0.0, 0.0] }
step_s = 0.5
[[pursuer]]
position_m = [5.0, 0.0, 4.0]
scatter_m = 4.0
speed_m_s = 2.0
[[pursuer]]
position_m = [2.0, 2.0, 3.0]
speed_m_s = 2.5
policy = "pure_pursuit"
[[evader]]
position_m = [12.0, 0.0]
scatter_m = 5.0
speed_m_s = 1.0
"""

SWEEP = """
scenario = "short.toml"
seeds = 2
[grid]
"pursuer[0].count" = [1, 2]
"evader[0].count" = [1, 3]
[random]
"evader[0].speed_m_s" = { uniform = [0.9, 1.1] }
"""


@pytest.fixture
def swept(tmp_path):
    (tmp_path / "short.toml").write_text(SCENARIO)

    def make(text=SWEEP, way=None):
        path = tmp_path / "sweep.toml"
        path.write_text(text)
        return planned(str(path), way)

    return make


def run(plan, out, rows=3):
    work = begin_or_continue(out, plan, rows, 1)
    finish(work, lambda _: None)
    return work


def test_numbers_of_players_are_swept_and_every_evader_has_a_row(swept, tmp_path):
    """Catches an evader without a row when numbers of players are swept."""
    plan = swept()
    run(plan, tmp_path / "out")
    table = parquet.read_table(tmp_path / "out" / "rows")
    assert plan.rows == 8
    assert table.num_rows == 2 * (1 + 3) * 2
    assert table.schema.equals(plan.schema)
    assert set(table["row"].to_pylist()) == set(range(8))
    for row in table.to_pylist():
        assert row["pursuers"] == row["pursuer[0].count"] + 1
        assert row["evaders"] == row["evader[0].count"]
        assert 0 <= row["evader"] < row["evaders"]
        assert row["pursuer_policy"] == "optimal+pure_pursuit"
        assert 0.9 <= row["evader[0].speed_m_s"] <= 1.1
    scenario = next(scenarios_of(plan, plan.cases(table["row"].to_numpy()[-1:])))
    assert summary_of(play_teams([scenario])[0])["guaranteed"] == table["guaranteed"][-1].as_py()


def test_policies_are_those_of_the_whole_team(swept, tmp_path):
    """Catches a sweep's policy that only the first group of a team plays."""
    plan = swept(
        'scenario = "short.toml"\n'
        '[[policies]]\npursuer = ["optimal", "pure_pursuit"]\nevader = "task_oriented"\n'
    )
    run(plan, tmp_path / "out")
    rows = parquet.read_table(tmp_path / "out" / "rows").to_pylist()
    assert {row["pursuer_policy"] for row in rows} == {"optimal", "pure_pursuit"}
    assert {row["evader_policy"] for row in rows} == {"task_oriented"}
    with pytest.raises(
        ConfigError, match=r"pursuer\[0\]\.policy = 'proportional_navigation': allowed are optimal"
    ):
        swept(SWEEP + '[[policies]]\npursuer = "proportional_navigation"\n')


def test_a_row_that_allows_no_game_says_why(swept, tmp_path):
    """Catches a row of teams without a game that ends the sweep or has no reason."""
    plan = swept(
        'scenario = "short.toml"\nseeds = 6\n'
        '[random]\n"evader[0].speed_m_s" = { choice = [1.0, 2.2] }\n'
    )
    run(plan, tmp_path / "out")
    rows = parquet.read_table(tmp_path / "out" / "rows").to_pylist()
    wrong = [row for row in rows if row["end"] == "invalid"]
    assert 0 < len(wrong) < len(rows)
    assert all("must be above 1" in row["reason"] for row in wrong)
    assert all(row["evader"] == -1 for row in wrong)


@pytest.mark.usefixtures("undrawn")
def test_the_report_counts_evaders_and_writes_the_worst_as_scenarios_of_teams(swept, tmp_path):
    """Catches a report that counts games for evaders."""
    text = SWEEP.replace("seeds = 2", "seeds = 1")
    plan = swept(text + '[[policies]]\npursuer = ["optimal", "pure_pursuit"]\n')
    run(plan, tmp_path / "out", rows=16)
    files = write_sweep_report(tmp_path / "out", tmp_path / "report", worst=1)
    report = json.loads((tmp_path / "report" / "report.json").read_text())
    assert report["rows"] == 2 * report["rows_planned"] == 16
    assert report["unit"] == "m"
    worst = next(path for path in files if path.suffix == ".toml")
    assert len(load_any(str(worst))[1].pursuer) == 2
    folder = read_folder(tmp_path / "out")
    with pytest.raises(ConfigError, match="has teams, whose rows are evaders"):
        compare_sweeps(folder, folder, column="game_time_s", rows=3)


def test_teams_do_not_fly_in_sweeps_either(swept):
    with pytest.raises(
        ConfigError, match=r'as = "fast": the scenario has teams, which can only be played as maths'
    ):
        swept(way="fast")


def test_a_key_that_no_team_has_is_refused(swept):
    with pytest.raises(ConfigError, match=r"pursuer\[2\].count: the scenario has no element 2"):
        swept(SWEEP.replace('"pursuer[0].count"', '"pursuer[2].count"'))
    with pytest.raises(ConfigError, match=r"count = 99"):
        swept(SWEEP.replace('"evader[0].count" = [1, 3]', '"evader[0].count" = [1, 99]'))


def test_the_sweep_that_comes_along_can_be_played():
    plan = planned("teams")
    assert plan.rows == 120
    assert all(
        not isinstance(one, str) for one in scenarios_of(plan, plan.cases(np.arange(0, 120, 20)))
    )
