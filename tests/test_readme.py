"""The README says nothing that does not run."""

import doctest
import importlib.util
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner
from typer.main import get_command

from guidance.cli.program import app as guidance
from guidance.sim.scenario import Scenario
from guidance.sim.scenario_file import load_scenario
from sitl_mock.cli import app as sitl_mock
from tests.__main__ import STEPS
from tests.harness.command import guidance as run_guidance

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BIN = Path(sys.executable).parent
PROGRAMS = {"guidance": get_command(guidance), "sitl-mock": get_command(sitl_mock)}
COMMANDS = sorted(set(re.findall(r"`(guidance|sitl-mock) ([a-z]+)", README)))


def test_its_python_examples_give_what_they_show():
    result = doctest.testfile(str(ROOT / "README.md"), module_relative=False, verbose=False)
    assert result.attempted >= 5
    assert result.failed == 0


def test_its_first_two_commands_are_one_line_each_and_the_second_is_what_ci_runs():
    blocks = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    assert [block.count("\n") for block in blocks[:2]] == [1, 1]
    assert blocks[0].strip().endswith("guidance fly")
    line = re.compile(r"^python3 -m venv .*-m tests$", re.MULTILINE)
    assert line.findall(README) == [blocks[1].strip()]
    assert "'^python3 -m venv .*-m tests$' README.md" in (ROOT / ".ci" / "run").read_text(
        encoding="utf-8"
    )


@pytest.mark.flight
def test_its_first_command_flies_in_virtual_time(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first = re.search(r"\.venv/bin/guidance (\w+)$", README, re.MULTILINE)
    done = run_guidance(first[1], "--fast")
    assert done.returncode == 0, done.stderr
    assert "captured" in done.stdout
    assert list(tmp_path.rglob("record.mcap"))


@pytest.mark.parametrize(("program", "command"), COMMANDS)
def test_every_command_it_names_explains_itself(program, command):
    done = CliRunner().invoke(PROGRAMS[program], [command, "--help"])
    assert done.exit_code == 0
    assert "Usage" in done.output


@pytest.mark.parametrize("program", PROGRAMS)
def test_its_programs_are_installed(program):
    done = subprocess.run([BIN / program, "--help"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert {command for name, command in COMMANDS if name == program} <= set(done.stdout.split())


def test_every_file_and_picture_it_names_is_there():
    named = re.findall(r"\]\(([^)h#][^)]*)\)", README) + re.findall(
        r"`((?:guidance|sitl_mock|config|tests)/[\w./-]+)`", README
    )
    assert len(named) > 8
    missing = [name for name in named if not (ROOT / name).exists()]
    assert missing == []


def test_its_moving_picture_is_of_the_scenario_that_its_first_command_flies():
    from PIL import ExifTags, Image

    with Image.open(ROOT / ".readme" / "flight-pe.webp") as picture:
        described = json.loads(picture.getexif()[ExifTags.Base.ImageDescription])
    _, scenario = load_scenario("pe")
    assert Scenario(**described) == scenario


def test_every_row_of_the_safety_table_names_a_test_that_exists():
    page = ROOT / "docs" / "explanation" / "when-things-fail.md"
    table = page.read_text(encoding="utf-8").partition("| what fails |")[2].partition("\n\n")[0]
    rows = table.splitlines()[2:]
    assert len(rows) > 15
    for row in rows:
        named = re.search(r"\[`(test_\w+)`\]\(([^)]+)\) \|$", row)
        assert named, row
        test, file = named.groups()
        assert f"def {test}(" in (page.parent / file).read_text(encoding="utf-8"), row


def test_the_comparison_with_follow_modes_is_what_was_recorded():
    from tests.bench.follow_report import NAMES, flights, glance_table, page_table, standoff_table

    flown = flights()
    page = (ROOT / "docs" / "explanation" / "follow.md").read_text(encoding="utf-8")
    assert glance_table(flown) in page
    for autopilot in NAMES:
        assert page_table(flown, autopilot) in page
    assert standoff_table(flown) in page


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.name)
def test_every_file_and_module_that_a_page_of_the_docs_names_is_there(page):
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"guidance/(?:\w+/(?:ctl|live)|team/[A-Z]+)/", "", text)  # keys on Zenoh
    paths = re.findall(r"`(?:python )?((?:guidance|sitl_mock|config|tests|docs)/[\w./-]+)", text)
    modules = re.findall(r"`python -m (tests\.[\w.]+)", text)
    assert [name for name in paths if not (ROOT / name).exists()] == []
    assert [name for name in modules if importlib.util.find_spec(name) is None] == []


def test_the_citation_has_the_version_of_the_package_and_names_the_paper():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (ROOT / ".github" / "CITATION.cff").read_text(encoding="utf-8")
    keys = dict(re.findall(r"^(\w[\w-]*): (.+)$", citation, re.MULTILINE))
    assert (keys["version"], keys["license"]) == (project["version"], project["license"])
    assert project["urls"]["Paper"] in citation


def test_a_commit_is_held_to_the_steps_that_ci_begins_with():
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    assert re.findall(r"id: (\w+)", text) == ["format", "lint", "types", "layers"]
    hooks = dict(re.findall(r"id: (\w+)\n +name: \w+\n +entry: (.+)", text))
    for name, entry in hooks.items():
        program, *_ = entry.split()
        assert STEPS[name].command[0] == BIN / program
