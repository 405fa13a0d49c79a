"""A newcomer's installation: small, whole by itself, and clear about what it leaves out."""

import subprocess
import sys

import pytest

from guidance.errors import ConfigError
from guidance.extras import EXTRAS, require_extras
from tests.install import (
    LARGEST_MB,
    LARGEST_MOCK_MB,
    OF_EXTRAS,
    PROJECT,
    ROOT,
    Installed,
    first_heartbeat_s,
    mock_packages,
    trimming,
    wheel,
)


def without_extras(*arguments, folder):
    """Run the guidance command as if no package of an extra were installed."""
    code = f"""
import importlib.util, sys
class Absent:
    def find_spec(self, name, *_):
        if name.partition(".")[0] in {OF_EXTRAS!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, package=None: None if name in {OF_EXTRAS!r} else found(name, package)
sys.meta_path.insert(0, Absent())
from guidance.cli import main
sys.argv = ["guidance", *{arguments!r}]
main()
"""
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize(
    "arguments",
    [
        ("scenario", "run", "pe", "--as", "maths"),
        ("log", "info", str(ROOT / "tests" / "data" / "short_chase.mcap")),
        ("log", "export", str(ROOT / "tests" / "data" / "short_chase.mcap"), "flight.tlog"),
    ],
)
def test_games_and_records_need_no_extra(arguments, tmp_path):
    done = without_extras(*arguments, folder=tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (("sweep", "policies"), "sim"),
        (("sweep", "report", "."), "sim,plot"),
        (("compare", "a", "b"), "sim"),
        (("report", "record.mcap"), "plot"),
        (("paper",), "plot"),
        (("view", "record.mcap"), "viz"),
        (("panel",), "panel"),
        (("scenario", "show", "pe", "--out", "pe.png"), "plot"),
    ],
)
def test_a_command_whose_extra_is_missing_says_which_and_how_to_add_it(
    arguments, extra, tmp_path, monkeypatch
):
    from guidance.cli.program import app

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("guidance.extras.find_spec", lambda _: None)
    with pytest.raises(
        ConfigError, match=rf"not installed: pip install 'pursuit-guidance\[{extra}\]'"
    ):
        app(list(arguments), standalone_mode=False)


def test_teams_without_scipy_name_the_extra(tmp_path):
    done = without_extras("scenario", "run", "teams_tad", folder=tmp_path)
    assert done.returncode == 2
    assert (
        "match_teams: needs pyarrow, scipy, which are not installed: pip install 'pursuit-guidance[sim]'"
        in done.stderr
    )


def test_every_extra_that_a_message_names_is_declared_and_brings_what_is_missed():
    extras = PROJECT["optional-dependencies"]
    named = {"rerun": "rerun-sdk"}
    for extra, packages in EXTRAS.items():
        brought = " ".join(extras[extra])
        assert [name for name in packages if named.get(name, name) not in brought] == []
    assert {"sim", "plot", "viz", "torch", "jax", "all", "dev"} <= set(extras)
    require_extras("here everything is", *EXTRAS)


def test_a_container_leaves_out_what_the_page_about_small_computers_does():
    made_of = (ROOT / "docs" / "how-to" / "Containerfile").read_text(encoding="utf-8").splitlines()
    assert len(trimming()) == 2
    assert [line for line in trimming() if f"RUN {line}" not in made_of] == []


@pytest.mark.flight
def test_the_wheel_in_an_empty_environment_is_small_and_flies(tmp_path):
    base = Installed(wheel(tmp_path), sys.executable, tmp_path, linked=True)
    assert sum(megabytes for megabytes, _ in base.weights().values()) < LARGEST_MB
    assert base.present() == []
    flown = base.run("guidance", "fly", "--fast", str(ROOT / "tests" / "data" / "short_chase.toml"))
    assert flown.returncode == 0, flown.stderr
    assert (
        "picture  needs matplotlib, which is not installed: pip install 'pursuit-guidance[plot]'"
        in flown.stdout
    )
    assert base.run("sitl-mock", "list").returncode == 0
    refused = base.run("guidance", "sweep", "policies")
    assert (refused.returncode, "pursuit-guidance[sim]" in refused.stderr) == (2, True)


@pytest.mark.flight
def test_the_mock_alone_is_small_and_answers(tmp_path):
    mock = Installed(
        wheel(tmp_path), sys.executable, tmp_path, linked=True, packages=mock_packages()
    )
    weights = mock.weights()
    assert sum(megabytes for megabytes, _ in weights.values()) < LARGEST_MOCK_MB
    assert not {"numpy", "pymavlink", "mavsdk", "eclipse-zenoh"} & set(weights)
    assert first_heartbeat_s(mock) < 30.0
    assert mock.run("sitl-mock", "versions", "px4@1.17", "px4@1.18").returncode == 0
    refused = mock.run("sitl-mock", "calibrate", str(ROOT / "README.md"))
    assert (refused.returncode, "needs numpy" in refused.stderr) == (2, True)
