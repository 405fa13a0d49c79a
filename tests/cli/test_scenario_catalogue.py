import io
import re

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.cli.scenario import expected, facts_of, listing, names
from guidance.config import find
from guidance.sim.batch import stack
from guidance.sim.maths import opening, play_scenarios
from guidance.sim.scenario_file import load_any, load_scenario
from guidance.viz.figures import draw_scenario, played


def guidance(*arguments):
    return CliRunner().invoke(app, ["scenario", *map(str, arguments)], env={"COLUMNS": "200"})


def test_the_list_names_every_scenario_with_its_title_its_game_and_what_it_expects():
    done = guidance("list")
    assert done.exit_code == 0, done.output
    for name in names():
        scenario = load_any(name)[1]
        row = next(line for line in done.output.splitlines() if line.split()[0] == name)
        assert scenario.title in row
        assert re.search(rf" {scenario.game} ", row)
        assert expected(scenario).split(";")[0] in row


def test_show_explains_a_scenario_and_writes_its_picture(tmp_path):
    """Catches a value or a wind that `show` tells otherwise than the game."""
    done = guidance("show", "wind", "--out", tmp_path / "wind.png")
    assert done.exit_code == 0, done.output
    assert "from the west" in done.output
    value = opening(stack([load_scenario("wind")[1]])).value[0]
    assert f"{value:.2f} s to capture" in done.output
    assert "(2, 0) m/s, east and north" in done.output
    assert (tmp_path / "wind.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", ["fence", "barrier_evader", "evader_turns"])
def test_fences_targets_and_courses_are_drawn(name, tmp_path):
    """Catches a scenario whose fence, target or course cannot be drawn."""
    draw_scenario(load_scenario(name)[1], tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 20_000


def test_the_tracks_in_the_picture_are_those_that_are_played():
    scenario = load_scenario("barrier_pursuer")[1]
    played_s, pursuer, evader = played(stack([scenario]))
    outcome = play_scenarios([scenario])[0]
    assert played_s == outcome.game_time_s
    assert np.hypot(*(evader[-1, :2] - scenario.target.position_m)) == pytest.approx(
        outcome.evader_to_target_m
    )
    assert pursuer[:, 2].min() == outcome.min_altitude_m


def test_what_is_told_of_a_scenario_names_its_faults_its_sensor_and_who_wins():
    takeover = dict(facts_of(load_scenario("pilot_takeover")[1]))
    assert takeover["fault"] == "pilot_mode of the pursuer 3 s after engagement, mode = POSCTL"
    assert "rate_hz = 1.0" in dict(facts_of(load_scenario("slow_reports")[1]))["sensor"]
    value = dict(facts_of(load_scenario("barrier_evader")[1]))["value"]
    assert value.startswith("in mathematics the evader wins: the pursuer misses by 1.6")
    assert "in flight the evader wins" in value
    assert "declares 1)" in dict(facts_of(load_scenario("faster_than_declared")[1]))["evader"]


@pytest.mark.parametrize("width", [60, 80, 120])
def test_the_list_fits_the_terminal_and_cuts_nothing(width):
    written = io.StringIO()
    Console(file=written, width=width).print(listing(width))
    said = written.getvalue()
    assert all(len(line) <= width for line in said.splitlines())
    assert "…" not in said
    assert all(name in said for name in names())


def test_text_of_a_strangers_file_cannot_command_the_terminal(tmp_path):
    path = tmp_path / "a.toml"
    text = find("pe", "scenarios").read_text()
    path.write_text(re.sub("title = .*", r'title = "[red]\\u001b]0;owned\\u0007"', text, count=1))
    said = guidance("show", path).output
    assert "\x1b" not in said
    assert r"[red]\x1b]0;owned\x07" in said
