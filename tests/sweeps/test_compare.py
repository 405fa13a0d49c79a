import json
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy import stats
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.errors import ConfigError
from guidance.sim.maths import play_scenarios
from guidance.sim.outcome import outcome_json
from guidance.sim.scenario_file import load_any, load_scenario
from guidance.sim.teams import play_teams
from guidance.sweeps.compare import (
    compare_sweeps,
    difference_of_means,
    matched_pairs,
    mean,
    success_share,
)
from guidance.sweeps.folder import begin_or_continue, read_folder
from guidance.sweeps.rows import scenario_of
from guidance.sweeps.running import finish

BASE = """
scenario = "short.toml"
seeds = 10
policies = [{ pursuer = PURSUERS, evader = "random_turns" }]
[grid]
"evader.speed_m_s" = [1.0, 3.0]
[random]
"evader.position_m" = { annulus = [8, 14] }
"""


@pytest.fixture
def swept(plan_from, tmp_path):
    def make(name, text=BASE, pursuers='"optimal"', chunk=7):
        plan = plan_from(text.replace("PURSUERS", pursuers))
        finish(begin_or_continue(tmp_path / name, plan, chunk), lambda _: None)
        return read_folder(tmp_path / name)

    return make


def regrets(folder):
    return pa.concat_tables([parquet.read_table(part) for part in folder.parts])[
        "regret"
    ].to_numpy()


def test_intervals_are_scipys():
    rng = np.random.default_rng(1)
    a = rng.normal(0.0, 1.0, 30)
    b = rng.normal(0.5, 3.0, 12)
    expected = stats.ttest_ind(b, a, equal_var=False).confidence_interval()
    assert difference_of_means(a, b)[1:] == pytest.approx((expected.low, expected.high))
    expected = stats.ttest_1samp(a, 0.0).confidence_interval()
    assert mean(a)[1:] == pytest.approx((expected.low, expected.high))


def test_too_few_numbers_have_no_interval():
    assert np.isnan(mean(np.empty(0))).all()
    assert np.isnan(mean(np.array([4.0]))[1:]).all()
    assert np.isnan(success_share(0, 0)).all()
    assert difference_of_means(np.array([1.0]), np.array([3.0])).estimate == 2.0
    assert difference_of_means(np.ones(3), np.ones(4)) == (0.0, 0.0, 0.0)


def test_sweeps_of_two_policies_pair_row_by_row(swept):
    """Catches rows of two sweeps that are paired wrongly, or an interval that is not Student's."""
    a = swept("a")
    b = swept("b", pursuers='"lead_pursuit"', chunk=3)
    compared = compare_sweeps(a, b, column="regret", rows=3)
    group = compared["groups"][0]
    assert compared["paired"]
    assert (group["a"], group["b"], group["rows_a"]) == (
        "optimal / random_turns",
        "lead_pursuit / random_turns",
        20,
    )
    apart = regrets(b) - regrets(a)
    expected = stats.ttest_1samp(apart, 0.0).confidence_interval()
    found = group["columns"]["regret"]["difference"]
    assert (found["low"], found["high"]) == pytest.approx((expected.low, expected.high))
    order = np.argsort(-np.abs(apart))[:3]
    assert [row["row_a"] for row in compared["largest"]] == order.tolist()
    assert [row["difference"] for row in compared["largest"]] == pytest.approx(
        apart[order].tolist()
    )


def test_a_sweep_does_not_differ_from_itself(swept):
    a = swept("a")
    b = swept("b", chunk=20)
    compared = compare_sweeps(a, b, column="game_time_s", rows=5)
    assert compared["largest"] == []
    differences = {
        name: column["difference"] for name, column in compared["groups"][0]["columns"].items()
    }
    known = {name: found for name, found in differences.items() if found["estimate"] is not None}
    assert {"game_time_s", "regret"} <= set(known)
    for found in known.values():
        assert [found[key] for key in ("estimate", "low", "high")] == [0.0] * 3


def test_rows_pair_by_seed_and_policy_whatever_their_order(swept):
    a = swept("a", pursuers='["optimal", "lead_pursuit"]')
    b = swept(
        "b",
        BASE.replace("seeds = 10", "seeds = [7, 3, 12]"),
        pursuers='["lead_pursuit", "pure_pursuit"]',
    )
    compared = compare_sweeps(a, b, column="game_time_s", rows=5)
    assert matched_pairs(a.plan, b.plan) == {1: 0}
    assert [group["rows_a"] for group in compared["groups"]] == [4]
    assert compared["groups"][0]["columns"]["game_time_s"]["difference"]["estimate"] == 0.0


def test_sweeps_over_different_values_are_independent(swept):
    a = swept("a")
    b = swept("b", BASE.replace("[8, 14]", "[10, 14]"))
    compared = compare_sweeps(a, b, column="regret", rows=5)
    assert not compared["paired"]
    expected = stats.ttest_ind(regrets(b), regrets(a), equal_var=False).confidence_interval()
    found = compared["groups"][0]["columns"]["regret"]["difference"]
    assert (found["low"], found["high"]) == pytest.approx((expected.low, expected.high))
    assert compared["groups"][0]["columns"]["captured"]["difference"]["estimate"] == 0.0
    assert compared["largest"] == []


def test_an_unknown_column_is_refused_with_those_allowed(swept):
    a = swept("a")
    with pytest.raises(ConfigError, match="--by speed: allowed are game_time_s, capture_time_s"):
        compare_sweeps(a, a, column="speed", rows=1)


def test_the_command_compares_sweeps_and_outcomes(swept, tmp_path):
    a = swept("a")
    b = swept("b", pursuers='"pure_pursuit"')
    shown = CliRunner().invoke(app, ["compare", str(a.path), str(b.path), "--rows", "2"])
    assert "20 paired rows" in shown.stdout
    assert "captured" in shown.stdout
    for name, folder in (("one.json", a), ("other.json", b)):
        outcome = play_scenarios([scenario_of(folder.plan, 4)])[0]
        (tmp_path / name).write_text(json.dumps(outcome_json(outcome)))
    both = [str(tmp_path / "one.json"), str(tmp_path / "other.json")]
    compared = json.loads(CliRunner().invoke(app, ["compare", *both, "--json"]).stdout)
    assert compared["pursuer_policy"] == {"a": "optimal", "b": "pure_pursuit", "difference": None}
    time_s = compared["game_time_s"]
    assert time_s["difference"] == time_s["b"] - time_s["a"]
    assert "game_time_s" in CliRunner().invoke(app, ["compare", *both]).stdout


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "not valid JSON"),
        ("[" * 100_000, "not valid JSON"),
        ('{"end": 1' + "0" * 400 + "}", "more than 64 bits"),
        ('{"a": 1}', "not an outcome"),
        (None, "cannot be read"),
    ],
)
def test_a_file_that_is_not_an_outcome_is_refused(tmp_path, content, words):
    path = tmp_path / "a.json"
    if content is not None:
        path.write_text(content)
    done = CliRunner().invoke(app, ["compare", str(path), str(path)])
    assert words in str(done.exception)


def test_an_outcome_and_a_sweep_are_not_compared(swept, tmp_path):
    (tmp_path / "a.json").write_text("{}")
    done = CliRunner().invoke(app, ["compare", str(tmp_path / "a.json"), str(swept("b").path)])
    assert "must be two outcomes or two sweeps" in str(done.exception)


def test_no_number_is_cut_in_a_narrow_terminal(swept, tmp_path):
    """Catches a number that a narrow table cuts."""
    a = swept("a")
    b = swept("b", pursuers='"pure_pursuit"')
    for name, folder in (("a.json", a), ("b.json", b)):
        (tmp_path / name).write_text(
            json.dumps(outcome_json(play_scenarios([scenario_of(folder.plan, 4)])[0]))
        )
    for pair in ((a.path, b.path), (tmp_path / "a.json", tmp_path / "b.json")):
        said = [
            CliRunner()
            .invoke(app, ["compare", *map(str, pair), "--rows", "0"], env={"COLUMNS": str(width)})
            .stdout
            for width in (60, 400)
        ]
        narrow, wide = (re.findall(r"-?\d+\.?\d*(?:e-\d+)?", text) for text in said)
        assert narrow == wide


def test_outcomes_of_teams_are_compared_evader_by_evader(tmp_path):
    """Catches outcomes of teams that are compared with another evader's."""
    scenario = load_any("teams_tad")[1]
    slower = scenario.model_copy(update={"step_s": 0.5})
    paths = []
    for name, played in (("a", scenario), ("b", slower)):
        rows = [outcome_json(row) for row in play_teams([played])[0]]
        paths.append(str(tmp_path / f"{name}.json"))
        Path(paths[-1]).write_text(json.dumps(rows))
    compared = json.loads(CliRunner().invoke(app, ["compare", *paths, "--json"]).stdout)
    assert list(compared) == [f"evader {number}" for number in range(len(rows))]
    time_s = compared["evader 0"]["game_time_s"]
    assert time_s["difference"] == time_s["b"] - time_s["a"]
    assert "evader 1" in CliRunner().invoke(app, ["compare", *paths]).stdout
    Path(paths[1]).write_text(json.dumps(rows[:1]))
    done = CliRunner().invoke(app, ["compare", *paths])
    assert "must be games of the same evaders" in str(done.exception)
    Path(paths[1]).write_text(
        json.dumps(outcome_json(play_scenarios([load_scenario("wind")[1]])[0]))
    )
    done = CliRunner().invoke(app, ["compare", *paths])
    assert "two outcomes of teams or none" in str(done.exception)


def test_a_run_as_mathematics_and_a_flight_are_said_to_be_different_games(tmp_path):
    outcome = play_scenarios([load_scenario("wind")[1]])[0]
    paths = [str(tmp_path / "maths.json"), str(tmp_path / "flown.json")]
    for path, run in zip(paths, ("maths", "fast"), strict=True):
        Path(path).write_text(json.dumps(outcome_json(outcome._replace(run=run))))
    shown = CliRunner().invoke(app, ["compare", *paths]).stdout
    assert "wind: in mathematics it carries the pursuer and both players know it" in shown
    assert "in flight no player knows it" in shown
    assert "wind:" not in CliRunner().invoke(app, ["compare", paths[0], paths[0]]).stdout
