"""The documentation's commands, files, Python code, examples and notebooks run as shown.

In a page's ```console blocks a line `$ guidance …` is run in the page's own folder, and every line shown below it must
be in what it prints, in this order; `…` stands for anything. A ```toml block whose first line is a comment with a
file's name is written there; ```python blocks are run one after another. The options in ```sh blocks must exist.
"""

import configparser
import doctest
import json
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer
from click.testing import CliRunner

from guidance.cli.program import app as guidance_app
from guidance.flight.freshness import AGES
from guidance.log.entries import CYCLE
from guidance.sim.outcome import Outcome
from guidance.sim.scenario_file import scenario_schema
from sitl_mock.cli import app as mock_app
from tests.bench.bench_walk import lines_of, named_walks

DOCS = Path(__file__).parents[1] / "docs"
EXAMPLES = DOCS / "examples"
PAGES = sorted(DOCS.rglob("*.md"))
RUN_ELSEWHERE = {
    "mock.md": "tests/sitl_mock/test_mock_page.py",
    "zenoh.md": "tests/links/zenoh/test_docs.py",
}
"""Pages whose examples need more than an empty folder, and the tests that run them."""

PROGRAMS = {
    "guidance": typer.main.get_command(guidance_app),
    "sitl-mock": typer.main.get_command(mock_app),
}


def test_the_walks_name_functions_that_exist():
    walks = named_walks((DOCS / "architecture.md").read_text(encoding="utf-8"))
    assert walks
    assert [hop for walk in walks for hop in walk.hops if not lines_of(*hop)] == []


def test_the_tables_of_rooms_name_folders_that_exist_and_all_those_of_the_mock():
    root = DOCS.parent
    rows = (DOCS / "architecture.md").read_text(encoding="utf-8").split("| room | contents |")[1:]
    rooms = {
        room
        for table in rows
        for row in table.partition("\n\n")[0].splitlines()[2:]
        for room in re.findall(r"`([\w/]+)`", row.split("|")[1])
    }
    assert rows
    folders = {room: root / room for room in rooms}
    folders |= {r: root / "guidance" / r for r in rooms if not r.startswith("sitl_mock/")}
    assert [room for room, folder in folders.items() if not folder.is_dir()] == []
    mocks = {f"sitl_mock/{init.parent.name}" for init in root.glob("sitl_mock/*/__init__.py")}
    assert mocks == {room for room in rooms if room.startswith("sitl_mock/")}


def test_each_extension_names_its_way_in_and_tests_that_exist():
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    section = re.search(r"^## [^\n]*extensions.*?(?=^## )", page, re.MULTILINE | re.DOTALL)[0]
    extensions = section.split("\n**")[1:]
    assert extensions
    sources = "".join(
        path.read_text(encoding="utf-8") for path in Path(__file__).parent.rglob("test_*.py")
    )
    for extension in extensions:
        calls = re.findall(r"calls `([^`]+)` `([^`]+)`", extension)
        assert [lines_of(*call) > 0 for call in calls] == [True]
        named = re.findall(r"`(test_\w+)`", extension.partition("- Tests:")[2])
        assert named
        assert [test for test in named if f"def {test}(" not in sources] == []


def blocks(page, *kinds):
    """The blocks of a page: each one's kind and its text."""
    found = re.findall(
        r"^( *)```(\w+)[^\n]*\n(.*?)^ *```$",
        page.read_text(encoding="utf-8"),
        re.DOTALL | re.MULTILINE,
    )
    return [
        (kind, re.sub(rf"^{indent}", "", text, flags=re.MULTILINE))
        for indent, kind, text in found
        if kind in kinds
    ]


def with_blocks(*kinds):
    elsewhere = RUN_ELSEWHERE if set(kinds) & {"console", "python"} else {}
    pages = [page for page in PAGES if page.name not in elsewhere and blocks(page, *kinds)]
    return pytest.mark.parametrize(
        "page", pages, ids=lambda page: page.relative_to(DOCS).as_posix()
    )


def run_console(text):
    """Run the commands of a console example, and look for the shown output."""
    for block in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        typed, _, shown = block.partition("\n")
        program, *arguments = shlex.split(typed)
        done = CliRunner().invoke(PROGRAMS[program], arguments, env={"COLUMNS": "200"})
        said = " ".join(done.output.split())
        assert done.exit_code == 0, f"{typed}: {said} {done.exception!r}"
        place = 0
        for line in shown.splitlines():
            for part in filter(None, (" ".join(part.split()) for part in line.split("…"))):
                found = said.find(part, place)
                assert found >= 0, f"{typed}: {part!r} is not in what it prints: {done.output}"
                place = found + len(part)


@pytest.mark.flight
@with_blocks("console", "python")
def test_what_a_page_types_gives_what_it_shows(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = {"__name__": page.stem}
    for kind, text in blocks(page, "console", "python", "toml"):
        named = re.match(r"# (\S+\.toml)\n", text)
        if kind == "console":
            run_console(text)
        elif kind == "python":
            exec(compile(text, str(page), "exec"), names)
        elif named:
            Path(named[1]).write_text(text, encoding="utf-8")
    if page.name == "records.md":
        lasted_s = example("read_record.py", tmp_path / "flown" / "record.mcap")
        assert lasted_s["engaged"] > 1.0
        assert "promised at engagement" in capsys.readouterr().out


@with_blocks("toml")
def test_the_toml_of_a_page_is_toml(page):
    for _, text in blocks(page, "toml"):
        tomllib.loads(text)


@with_blocks("sh")
def test_the_options_that_a_page_names_exist(page):
    for _, text in blocks(page, "sh"):
        for line in text.replace("\\\n", " ").splitlines():
            typed = line.partition("  #")[0]
            for found in re.finditer(r"(?:^|[&;|] )((?:guidance|sitl-mock)(?: [^&;|>]*)?)", typed):
                words = shlex.split(found[1])
                parse(PROGRAMS[words[0]], words)


def parse(command, words):
    """Read arguments as the program does, down to the last sub-command, and run nothing."""
    while True:
        context = command.make_context(words[0], list(words[1:]), resilient_parsing=False)
        if not hasattr(command, "commands"):
            return
        name, command, rest = command.resolve_command(
            context, context._protected_args + context.args
        )
        words = [name, *rest]


@with_blocks("pycon")
def test_the_interpreter_sessions_of_a_page_are_true(page):
    """Catches a number in a page that the code no longer gives."""
    result = doctest.testfile(str(page), module_relative=False, verbose=False)
    assert (result.failed, result.attempted > 3) == (0, True)


def example(name, *arguments):
    """Run an example as a person does, in this process."""
    return runpy.run_path(str(EXAMPLES / name), run_name="example")["main"](*arguments)


def test_the_examples_run(tmp_path, capsys):
    """Catches an example of the documentation that does not run."""
    example("million_states.py", 4_000, tmp_path / "barrier.png")
    assert (tmp_path / "barrier.png").stat().st_size > 10_000
    assert "the pursuer wins 9" in capsys.readouterr().out
    example("own_evader.py")
    assert "the zigzag: captured" in capsys.readouterr().out
    example("train_policy.py", 1, tmp_path / "trained", 4)
    assert (tmp_path / "trained" / "learning.png").stat().st_size > 5_000
    assert "1 iterations: median regret" in capsys.readouterr().out
    played = example("teams.py")
    assert int(played.first.guaranteed) == 4


def test_a_source_of_ones_own_is_read():
    reports = example("own_source.py", 3, 50.0)
    assert [round(report.velocity_ned_m_s[0], 1) for report in reports] == [3.0, 3.0, 3.0]
    assert reports[-1].latitude_deg > reports[0].latitude_deg


@pytest.mark.parametrize("notebook", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_runs_from_top_to_bottom(notebook, monkeypatch):
    import matplotlib as mpl

    monkeypatch.setattr(mpl, "get_backend", lambda *_: "agg")
    mpl.use("agg")
    content = json.loads(notebook.read_text(encoding="utf-8"))
    names = {"__name__": notebook.stem}
    cells = ["".join(cell["source"]) for cell in content["cells"] if cell["cell_type"] == "code"]
    assert len(cells) >= 3
    for cell in cells:
        exec(compile(cell, notebook.name, "exec"), names)
    assert all(not cell.get("outputs") for cell in content["cells"])


@pytest.mark.parametrize("page", RUN_ELSEWHERE)
def test_a_page_that_is_run_elsewhere_is_run_there(page):
    assert page in (DOCS.parent / RUN_ELSEWHERE[page]).read_text(encoding="utf-8")


def test_every_page_and_example_is_in_the_contents():
    contents = (DOCS.parent / ".mkdocs.yml").read_text(encoding="utf-8")
    absent = [page for page in PAGES if page.relative_to(DOCS).as_posix() not in contents]
    assert absent == []
    listed = (EXAMPLES / "index.md").read_text(encoding="utf-8")
    examples = [*EXAMPLES.glob("*.py"), *EXAMPLES.glob("*.ipynb")]
    assert examples
    assert [path.name for path in examples if path.name not in listed] == []


def links(text):
    """Return the file and section of every relative link."""
    prose = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.DOTALL | re.MULTILINE)
    return [link.partition("#")[::2] for link in re.findall(r"\]\((?!\w+:)([^)]+)\)", prose)]


def sections(text):
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", [*PAGES, DOCS.parent / "README.md"], ids=lambda page: page.name)
def test_every_link_works_in_the_repository(page):
    for file, section in links(page.read_text(encoding="utf-8")):
        target = page.parent / file if file else page
        assert target.exists(), file
        assert not section or section in sections(target.read_text(encoding="utf-8")), (
            f"{file}#{section}"
        )


def test_every_link_works_on_the_site():
    hooks = runpy.run_path(str(DOCS / "hooks.py"), run_name="hooks")
    pictures = {f"pictures/{path.name}" for path in (DOCS.parent / ".readme").glob("*.png")}
    for page in PAGES:
        uri = page.relative_to(DOCS).as_posix()
        for file, _ in links(hooks["site_links"](page.read_text(encoding="utf-8"), uri)):
            target = os.path.relpath(page.parent / file, DOCS)
            assert (DOCS / target).is_file() or target in {*hooks["PAGES"], *pictures}, (
                f"{uri}: {file}"
            )
    led = hooks["site_links"](
        "[a](../../guidance/cycle/monitor.py) [b](../../.readme/p.png) [c](../../x.py)",
        "how-to/a.md",
    )
    assert led == "[a](../reference/alarms.md) [b](../pictures/p.png) c"


def test_the_pages_made_of_the_code_name_every_key_and_every_option():
    hooks = runpy.run_path(str(DOCS / "hooks.py"), run_name="hooks")
    pages = {uri: write() for uri, write in hooks["PAGES"].items()}
    sections = {name: part for name, part in scenario_schema()["$defs"].items() if name != "Range"}
    keys = {key for section in sections.values() for key in section.get("properties", {})}
    said = pages["reference/scenario-file.md"]
    assert [key for key in sorted(keys) if f"`{key}`" not in said and f"{key}]" not in said] == []
    assert "`--speed-ratio`" in pages["reference/commands.md"]
    assert CYCLE.topic in pages["reference/record.md"]
    assert all(f"| `{name}` |" in pages["reference/outcome.md"] for name in Outcome._fields)
    assert "external mode change" in hooks["failures"]()
    assert "`guidance_lateness_seconds`" in pages["reference/metrics.md"]


def test_the_table_of_ages_is_the_codes():
    hooks = runpy.run_path(str(DOCS / "hooks.py"), run_name="hooks")
    page = DOCS / "explanation" / "when-things-fail.md"
    text = page.read_text(encoding="utf-8")
    assert all(text.count(mark) == 1 for mark in hooks["TABLES"])
    shown = hooks["TABLES"]["<!-- the table of ages -->"]()
    assert [row for row in AGES if f"| {' | '.join(row)} |" not in shown] == []
    assert len(shown.strip().splitlines()) == len(AGES) + 2


def test_the_unit_file_is_right(tmp_path):
    unit = tmp_path / "guidance.service"
    text = (DOCS.parent / "config" / "systemd" / "guidance.service").read_text(encoding="utf-8")
    # Lists have one line per value
    sections = configparser.ConfigParser(strict=False, interpolation=None)
    sections.optionxform = str
    sections.read_string(text)
    service = sections["Service"]
    assert (service["Type"], service["KillSignal"], service["CPUSchedulingPolicy"]) == (
        "notify",
        "SIGTERM",
        "rr",
    )
    assert 0 < float(service["WatchdogSec"]) < float(service["TimeoutStopSec"])
    if shutil.which("systemd-analyze") is None:  # its own judge is where systemd is
        return
    unit.write_text(text.replace("/usr/local/bin/guidance", sys.executable), encoding="utf-8")
    command = ["systemd-analyze", "verify", "--man=no", str(unit)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    said = [line for line in done.stderr.splitlines() if "guidance.service" in line]
    assert (done.returncode, said) == (0, [])
    command = [
        "systemd-analyze",
        "security",
        "--offline=true",
        "--threshold=30",
        "--no-pager",
        str(unit),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout.splitlines()[-1]  # exposure of at most 3.0 of 10
