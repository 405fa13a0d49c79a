"""The acceptance flights themselves: possible as written, and a table that says so when something does not hold."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from guidance.config import parse_document
from guidance.sim.maths import play_scenarios
from guidance.sim.scenario import Scenario
from sitl_mock.child import running
from tests.acceptance.__main__ import main
from tests.acceptance.cases import (
    AT_ITS_SPEED,
    HONEST,
    LOST_AND_FOUND,
    LOST_BY_VEHICLE,
    WON_BY_VEHICLE,
    Wanted,
    cases,
    toml,
)

ROOT = Path(__file__).parents[2]
HEIGHTS_M = {"a simulator's": 20.0, "a stand-in's": 8.0}
IN_FLIGHT_ONLY = (*HONEST[1:], AT_ITS_SPEED, WON_BY_VEHICLE, LOST_BY_VEHICLE, LOST_AND_FOUND)
NEVER_IN_MATHEMATICS = {"end: yielded", *(one.words for one in IN_FLIGHT_ONLY)}


@pytest.mark.parametrize("height_m", HEIGHTS_M.values(), ids=list(HEIGHTS_M))
def test_between_point_masses_every_flight_ends_as_it_is_wanted_to(height_m):
    """Catches an acceptance flight whose wanted end is impossible in the game itself."""
    flights = [
        case for autopilot in ("px4", "arducopter") for case in cases(autopilot, height_m=height_m)
    ]
    scenarios = {toml(case.scenario): case.name for case in flights}
    parsed = [
        parse_document(Scenario, tomllib.loads(text), source=name)
        for text, name in scenarios.items()
    ]
    outcomes = dict(zip(scenarios, play_scenarios(parsed), strict=True))
    for case in flights:
        row = outcomes[toml(case.scenario)]._asdict()
        held = {
            one.words: one.held(one.got(row))
            for one in case.wanted
            if one.words not in NEVER_IN_MATHEMATICS
        }
        assert all(held.values()), (case.name, held, row)


def test_every_kind_of_flight_is_flown_by_a_stand_in_and_the_service_killed_on_both():
    flown = [(name, case) for name in ("px4", "arducopter") for case in cases(name, height_m=8.0)]
    by_stand_ins = {
        case.name.partition(", u")[0] for name, case in flown if name in case.autopilots
    }
    # The speeds may differ
    assert by_stand_ins == {case.name.partition(", u")[0] for _, case in flown}
    # Each has its own failsafe
    assert all(len(case.autopilots) == 2 for _, case in flown if case.meddling == "kill")
    assert {case.link for name, case in flown if name in case.autopilots} == {"mavsdk", "pymavlink"}


def test_a_figure_that_is_missing_or_too_large_does_not_hold():
    (limit,) = [
        one
        for case in cases("px4", height_m=8.0)[:1]
        for one in case.wanted
        if "flown/value" in one.words
    ]
    assert isinstance(limit, Wanted)
    assert [limit.held(limit.got({"ratio": ratio})) for ratio in (1.06, 1.061, None)] == [
        True,
        False,
        False,
    ]


def acceptance(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "tests", "acceptance", *arguments],
        capture_output=True,
        text=True,
        timeout=90,
        cwd=ROOT,
        check=False,
    )


def test_without_a_vehicle_at_the_url_the_table_says_so_and_the_exit_code_too(tmp_path):
    """Catches an acceptance that ends with 0 though no vehicle was there."""
    done = acceptance("--px4", "tcpout://127.0.0.1:9", "--report", str(tmp_path / "report"))
    assert done.returncode == 1
    assert "127.0.0.1:9" in done.stdout
    assert "0 of 1 as wanted" in done.stdout
    assert "<table>" in (tmp_path / "report" / "acceptance.html").read_text()


def test_another_autopilot_than_the_one_named_is_not_flown(capsys):
    """Catches a PX4 that the acceptance flies by ArduCopter's table."""
    with running([{"name": "uav1", "flavour": "px4", "ready_after_s": 1.0}], over=["udp"]) as fleet:
        assert main(["--arducopter", fleet["uav1"].udp]) == 1
    assert "px4 is there" in capsys.readouterr().out


def test_nothing_flown_is_nothing_shown():
    assert main(["--only", "a flight that is not there"]) == 1
