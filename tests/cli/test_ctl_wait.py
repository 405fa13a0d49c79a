"""`guidance ctl ORDER --wait`, and the values that a shell completes."""

import json

import pytest
from typer.testing import CliRunner

from guidance.cli import daemon
from guidance.cli.carrying_out import AIMS, carried_out
from guidance.cli.program import app


def statuses(*states, name="uav1", **fields):
    """Return a function that gives the status of one vehicle for each state, and then the last again and again."""
    left = [{"name": name, "state": state, **fields} for state in states]
    return lambda: [left.pop(0) if len(left) > 1 else left[0]]


def waited(order, ask_status):
    slept = []
    answers = carried_out(order, ask_status, slept.append)
    return answers, len(slept)


@pytest.mark.parametrize(
    ("order", "states"),
    [
        ("start", ["arming", "climbing", "positioning", "standing by"]),
        ("engage", ["entering", "engaged", "paused", "engaged", "on station"]),
        ("land", ["landing", "landed"]),
        ("return", ["returning", "landing", "landed"]),
    ],
)
def test_the_wait_ends_when_the_order_is_carried_out(order, states):
    (answer,), slept = waited(order, statuses(*states))
    assert answer == {"accepted": True, "name": "uav1", "order": order, "state": states[-1]}
    assert slept == len(states) - 1


def test_a_hold_is_carried_out_when_the_autopilot_holds():
    modes = iter(["guided", "guided", "hold"])
    answers, slept = waited(
        "hold", lambda: [{"name": "uav1", "state": "holding", "mode": next(modes)}]
    )
    assert answers[0]["accepted"]
    assert slept == 2


@pytest.mark.parametrize(
    ("order", "states", "cause"),
    [
        ("start", ["arming", "failed"], "arming refused"),
        ("start", ["climbing", "landing"], "by operator"),
        ("engage", ["engaged", "holding"], "evader lost"),
        ("land", ["landing", "holding"], "by operator"),
        ("land", ["landing", "yielded"], "external mode change"),
    ],
)
def test_another_end_is_a_refusal_with_its_cause(order, states, cause):
    (answer,), _ = waited(order, statuses(*states, cause=cause))
    assert not answer["accepted"]
    assert answer["state"] == states[-1]
    assert answer["reason"] == f"accepted, and not carried out: {cause}"


def test_a_capture_after_which_the_vehicle_returns_carries_out_engage():
    ask_status = statuses("returning", cause="stand-off reached, return configured")
    assert waited("engage", ask_status)[0][0]["accepted"]


def test_of_a_team_the_wait_is_for_every_vehicle(capsys):
    states = iter(
        [("climbing", "standing by"), ("positioning", "standing by"), ("standing by",) * 2]
    )

    def ask_status():
        return [
            {"name": name, "state": state}
            for name, state in zip(("uav1", "uav2"), next(states), strict=True)
        ]

    answers, slept = waited("start", ask_status)
    assert [answer["accepted"] for answer in answers] == [True, True]
    assert slept == 2
    assert capsys.readouterr().err.splitlines() == [
        "uav1: climbing",
        "uav2: standing by",
        "uav1: positioning",
        "uav1: standing by",
    ]


def test_the_command_waits_for_the_vehicle_that_answered(monkeypatch):
    asked = []

    def ask(order, **given):
        asked.append((order, given["name"]))
        return [{"name": "uav7", "order": order, "accepted": True, "state": "standing by"}]

    monkeypatch.setattr(daemon, "ask_daemon", ask)
    done = CliRunner().invoke(app, ["ctl", "start", "--wait", "--json"])
    assert done.exit_code == 0
    assert json.loads(done.stdout)["state"] == "standing by"
    assert asked == [("start", None), ("status", "uav7")]
    done = CliRunner().invoke(app, ["ctl", "reset", "--wait"])
    assert "--wait: only with " in str(done.exception)
    assert all(order in str(done.exception) for order in AIMS)


@pytest.mark.parametrize(
    ("words", "incomplete", "values"),
    [
        (["ctl"], "", {"start", "engage", "hold", "land", "return", "abort", "status"}),
        (["ctl"], "st", {"start", "status"}),
        (["scenario", "run", "pe", "--as"], "", {"maths", "fast", "live", "vehicle"}),
        (["sweep", "run", "barrier", "--as"], "m", {"maths"}),
        (["fly"], "cross", {"crossing", "crossing_proportional_navigation"}),
        (["fly", "pe", "--link"], "", {"mavsdk", "pymavlink"}),
    ],
)
def test_the_shell_completes_values(words, incomplete, values):
    line = " ".join(["guidance", *words, incomplete])
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(words) + 1)}
    shell = {**asked, "_GUIDANCE_COMPLETE": "complete_bash"}
    found = set(CliRunner().invoke(app, [], env=shell, prog_name="guidance").output.split())
    assert values <= found
    if incomplete:
        assert found == values
