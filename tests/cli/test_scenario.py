import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.errors import ConfigError
from guidance.sim.outcome import Outcome

SHORT = Path(__file__).parents[1] / "data" / "short_chase.toml"


def guidance(*arguments):
    return CliRunner().invoke(app, ["scenario", *map(str, arguments)], env={"COLUMNS": "160"})


def test_a_scenario_is_run_as_mathematics_and_its_row_written(tmp_path):
    done = guidance("run", "hover_chase", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    row = json.loads((tmp_path / "outcome.json").read_text())
    assert list(row) == list(Outcome._fields)
    assert row["end"] == "captured"
    assert row["reason"] == ""
    assert f"{row['predicted_capture_time_s']:.3f} s" in done.output


def test_a_number_that_there_is_none_of_is_null_in_json(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(SHORT.read_text().replace('game = "pe"', 'game = "pe"\ntime_limit_s = 0.5'))
    assert guidance("run", path, "--out", tmp_path).exit_code == 0
    assert json.loads((tmp_path / "outcome.json").read_text())["capture_time_s"] is None


def test_a_failed_expectation_is_exit_code_1_and_the_row_that_failed(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(
        SHORT.read_text() + "\n[expect]\ncapture_time_s = { max = 0.1 }\nend = 'captured'\n"
    )
    done = guidance("run", path)
    assert done.exit_code == 1
    failed = [line for line in done.output.splitlines() if "FAILS" in line]
    assert len(failed) == 1
    assert failed[0].split()[0] == "capture_time_s"
    assert "at most 0.1" in failed[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--as", "fats"], "--as fats: allowed are maths, fast, live, vehicle"),
        (["--as", "vehicle"], "--config: missing; --as vehicle needs a vehicle file"),
        (["--config", "px4.toml"], "--config: only with --as vehicle, not with --as maths"),
        (["--link", "mavsdk"], "--link: only with --as live, not with --as maths"),
        (["--as", "fast", "--over", "udp"], "--over: only with --as live, not with --as fast"),
        (["--as", "fast", "--port", "0"], "--port: only with --as live, not with --as fast"),
        (["--engage"], "--engage: only with --as vehicle, not with --as maths"),
        (["--as", "vehicle", "--config", "px4", "--yes"], "--yes: only with --engage, which arms"),
        (
            ["--as", "vehicle", "--config", "px4", "--engage"],
            "no answer to the question: nothing was done; --yes",
        ),
        (["--as", "live", "--over", "smoke"], "--over smoke: allowed are zenoh, udp"),
    ],
)
def test_wrong_options_are_refused_by_name(arguments, message):
    done = guidance("run", "hover_chase", *arguments)
    assert isinstance(done.exception, ConfigError)
    assert message in str(done.exception)


def test_show_says_both_games_where_mathematics_and_flights_differ():
    said = guidance("show", "wind").output
    assert "in mathematics" in said
    assert "in flight no player knows it, and the game is that of still air" in " ".join(
        said.split()
    )
    paper = " ".join(guidance("show", "pe").output.split())
    assert (
        "3 m/s (ball) in mathematics, and in flight 3 m/s level, 3 up, 2 down (cylinder)" in paper
    )
    assert "value in mathematics " in paper
    assert "; in flight " in paper


def test_the_shape_of_a_target_is_shown(tmp_path):
    path = tmp_path / "shaped.toml"
    players = SHORT.read_text().replace('game = "pe"', 'game = "tad"')
    path.write_text(
        players + "\n[target]\nposition_m = [0, 90]\nradius_m = 5\n"
        "polygon_m = [[-40, 0], [40, 0], [0, 20]]\n"
    )
    done = guidance("show", path)
    assert done.exit_code == 0, done.output
    assert "the polygon" in done.output
    assert "with 5 m around" in done.output
