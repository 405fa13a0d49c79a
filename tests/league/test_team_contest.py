import json

import numpy as np
import pytest
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.errors import ConfigError
from guidance.sim.scenario_file import load_any
from guidance.sim.teams import play_teams
from guidance.strategies import own


def straight_at_the_first_evader(observation):
    way = observation[:, 1:4]
    return way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)


def test_rules_of_teams_are_compared_and_only_plays_with_promises_keep_them(tmp_path):
    """Catches a comparison of team rules whose players or counts are mixed up."""
    own.register_policy("tests.team:first", straight_at_the_first_evader)
    bundled = load_any("teams_breakthrough")[0].read_text()
    scenario = tmp_path / "coarse.toml"
    scenario.write_text(bundled.replace("step_s = 0.2", "step_s = 1.0"))
    words = ("tests.team:first", "--scenario", str(scenario), "--games", "6", "--json")
    done = CliRunner().invoke(app, ["league", "run", *words])
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)["rows"]
    players = [row["player"] for row in rows if row["opponent"] == "task_oriented"]
    assert players == ["tests.team:first", "optimal", "captures", "nearest", "hungarian", "lead"]
    captured = {row["player"]: row["captured"] for row in rows if row["opponent"] != "optimal"}
    assert max(captured, key=captured.get) == "captures"
    assert all(row["fewer"] == 0 for row in rows if row["player"] in {"optimal", "captures"})


def test_a_users_policy_of_a_team_is_played_and_its_faults_are_named():
    """Catches a user's policy that is replaced by another without a word."""
    own.register_policy("tests.team:first", straight_at_the_first_evader)
    own.register_policy(
        "tests.team:lost", lambda observation: np.full((len(observation), 3), np.nan)
    )
    scenario = load_any("teams_breakthrough")[1]

    def played(policy):
        groups = [group.model_copy(update={"policy": policy}) for group in scenario.pursuer]
        return play_teams([scenario.model_copy(update={"pursuer": tuple(groups)})])[0]

    rows = played("tests.team:first")
    assert rows[0].pursuer_policy == "tests.team:first"
    assert rows[0].end == "captured"
    with pytest.raises(ConfigError, match="numbers that are not finite"):
        played("tests.team:lost")
