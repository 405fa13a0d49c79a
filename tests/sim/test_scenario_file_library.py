"""Every bundled scenario meets its expectations: as mathematics, and flown by the mock in virtual time."""

import functools
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from guidance.config import config_folder
from guidance.session.fly.result import outcome_of_flight
from guidance.sim.maths import play_scenarios
from guidance.sim.scenario_file import SCENARIO_FOLDER, load_any, load_scenario
from guidance.sim.teams import TeamScenario, play_teams, summary_of
from tests.harness.flights import Played, flown
from tests.harness.silences import silences

EVERY = sorted(path.stem for path in (config_folder() / SCENARIO_FOLDER).glob("*.toml"))
TEAMS = [name for name in EVERY if isinstance(load_any(name)[1], TeamScenario)]
NAMES = [name for name in EVERY if name not in TEAMS]
GUIDANCE = Path(sys.executable).parent / "guidance"
NEAR = Path(__file__).parents[1] / "data" / "near_chase.toml"
TAKEN_OVER = """
[[fault]]
kind = "pilot_mode"
mode = "POSCTL"
at_s = 1.0

[expect]
end = "yielded"
events = ["external mode change"]
"""
FLOWN_ELSEWHERE = ("pe", "tad")
"""In tests/session/test_fly.py, which holds them to the same."""

MATHEMATICS_SUFFICE = (
    "hover_chase", "evader_turns", "evader_stops", "barrier_pure_pursuit", "barrier_pursuer", "slower_than_declared",
    "crossing", "crossing_proportional_navigation", "barrier_evader", "faster_than_declared",
)  # fmt: skip
"""Played as mathematics in every run, and flown by the step `long`: no fault, wind, fence or sensor is part of them.

tests/test_promise_kept.py flies hover_chase.
"""


def failed(scenario, outcome):
    return [verdict for verdict in scenario.expect.verdicts(outcome._asdict()) if not verdict.held]


@pytest.mark.parametrize("name", EVERY)
def test_every_scenario_explains_itself_and_expects_something(name):
    path, scenario = load_any(name)
    assert len(scenario.description.split()) > 20
    expected = tomllib.loads(path.read_text())["expect"]
    assert expected


@functools.cache
def played():
    """All scenarios in one batch: a game is the same in a batch and alone."""
    scenarios = [load_scenario(name)[1] for name in NAMES]
    return dict(zip(NAMES, zip(scenarios, play_scenarios(scenarios), strict=True), strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_what_a_scenario_expects_holds_in_mathematics(name):
    """Catches a bundled scenario that no longer shows what it explains."""
    assert failed(*played()[name]) == []


@pytest.mark.parametrize("name", TEAMS)
def test_what_a_scenario_of_teams_expects_holds_in_mathematics(name):
    """Catches a bundled scenario of teams that no longer shows what it explains."""
    scenario = load_any(name)[1]
    verdicts = list(scenario.expect.verdicts(summary_of(play_teams([scenario])[0])))
    assert len(verdicts) > 1
    assert [verdict for verdict in verdicts if not verdict.held] == []


@pytest.mark.flight
@pytest.mark.usefixtures("soon_up_and_down")
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.long if name in MATHEMATICS_SUFFICE else ())
        for name in sorted({*NAMES} - {*FLOWN_ELSEWHERE})
    ],
)
def test_what_a_scenario_expects_holds_in_flight(name):
    scenario = load_scenario(name)[1]
    result = flown(scenario, mission=Played)
    assert failed(scenario, outcome_of_flight(result, "fast")) == []


@pytest.mark.slow
def test_a_fault_after_engagement_is_equal_in_real_and_virtual_time(tmp_path):
    scenario = tmp_path / "takeover.toml"
    scenario.write_text(NEAR.read_text() + TAKEN_OVER)
    command = [
        GUIDANCE,
        "scenario",
        "run",
        scenario,
        "--as",
        "live",
        "--over",
        "udp",
        "--out",
        tmp_path / "out",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, (
        done.stdout + done.stderr + silences(tmp_path / "out" / "record.mcap")
    )
    assert "yielded" in done.stdout
