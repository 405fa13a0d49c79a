"""The command as a whole: help, exit codes, and what it does where its output cannot be written or read."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from guidance import cli, errors
from guidance.cli import program
from guidance.cli.streams import PIPE_CLOSED

DOCS = Path(__file__).parents[2] / "docs"
PAPER = ("solve", "--pursuer", "8,1.42,9.41", "--evader", "7.92,9.6", "--speed-ratio", "2")


@pytest.mark.parametrize("arguments", [[], ["scenario"], ["log"], ["sweep"]])
def test_a_command_that_holds_others_shows_its_help_and_ends_well(arguments):
    result = CliRunner().invoke(program.app, arguments)
    assert result.exit_code == 0
    assert "--help" in result.output
    assert "Commands" in result.output


def test_the_help_of_sweep_shows_the_options_of_sweep_file():
    words = CliRunner().invoke(program.app, ["sweep", "--help"], env={"COLUMNS": "120"}).output
    for said in ("--workers", "--chunk", "FILE", "report"):
        assert said in words


def test_every_exit_code_is_in_the_table_of_the_documentation():
    table = {
        int(code)
        for code in re.findall(r"^\| (\d+) \|", (DOCS / "exit-codes.md").read_text(), re.MULTILINE)
    }
    family = {one.exit_code for one in errors.GuidanceError.__subclasses__()}
    assert len(family) == len(errors.GuidanceError.__subclasses__())  # one meaning each
    signals = {128 + number for number in (signal.SIGINT, signal.SIGPIPE, signal.SIGTERM)}
    assert table == {0, 1, cli.FAULT, *family, *signals}
    assert signal.SIGPIPE + 128 == PIPE_CLOSED


def run(stdout, *arguments, **environment):
    code = "import sys; sys.argv[0] = 'guidance'; from guidance.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        stdout=stdout,
        stderr=subprocess.PIPE,
        env={**os.environ, "COLUMNS": "80", **environment},
        timeout=60,
        check=False,
    )


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a full device is Linux's")
def test_a_full_disk_under_standard_output_is_a_message():
    """Catches a traceback where the kernel refuses standard output."""
    with Path("/dev/full").open("wb") as full:
        done = run(full, *PAPER)
    assert done.returncode == errors.OutputError.exit_code
    assert done.stderr.decode() == (
        "error: stdout: cannot be written (No space left on device); redirect it elsewhere\n"
    )


def test_who_stops_reading_ends_the_command_in_silence():
    """Catches a traceback for a closed pipe, and a wrong exit code."""
    reader, writer = os.pipe()
    os.close(reader)
    done = run(writer, *PAPER)
    os.close(writer)
    assert (done.returncode, done.stderr) == (PIPE_CLOSED, b"")


def test_a_terminal_without_the_letters_is_written_in_those_it_has():
    """Catches an error of encoding on a terminal of ASCII."""
    done = run(subprocess.PIPE, "solve", "--help", PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"delta = u/v" in done.stdout


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("δ = 2, 3 m ≤ R", "delta = 2, 3 m <= R"),
        ("Müller → T…", "Muller -> T..."),
        ("本", "\\u672c"),
    ],
)
def test_plain_letters(text, written):
    assert text.encode("ascii", "plain-letters").decode() == written


def test_help_imports_neither_rich_nor_numpy_nor_what_is_heavier():
    code = """
import atexit, sys
heavy = {"rich", "numpy", "pydantic", "zenoh", "mavsdk", "matplotlib"}
atexit.register(lambda: print(*sorted(heavy & set(sys.modules)), file=sys.stderr))
sys.argv = ["guidance", "--help"]
from guidance.cli import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60, check=True)
    assert b"Commands" in done.stdout
    assert done.stderr.strip() == b""


def test_a_ctrl_c_while_the_command_is_still_imported_prints_no_traceback():
    code = """
import sys

class Interrupting:
    def find_spec(self, name, *_):
        if name == "typer":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupting())
sys.argv = ["guidance", "fly"]
from guidance.cli import main
main()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (130, "error: interrupted before anything began\n")


@pytest.fixture
def main(monkeypatch):
    def called(*arguments):
        monkeypatch.setattr(sys, "argv", ["guidance", *map(str, arguments)])
        before = sys.stdout
        with pytest.raises(SystemExit) as ended:
            cli.main()
        monkeypatch.setattr(sys, "stdout", before)
        return ended.value.code

    return called


def test_what_nobody_foresaw_is_said_to_be_our_fault(main, monkeypatch, capfd):
    def broken():
        raise RuntimeError("unforeseen")

    monkeypatch.setattr(program, "app", broken)
    assert main() == cli.FAULT
    assert "internal error of guidance: please report it" in capfd.readouterr().err


STATES = "pursuer_x_m,pursuer_y_m,pursuer_z_m,evader_x_m,evader_y_m\n8,1.42,9.41,7.92,9.6\n"


SOLVE = ("solve", "--speed-ratio", "2", "--states", "states.csv", "--out")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("paper", "--out", "wall"), "wall"),
        ((*SOLVE, "wall/answers.csv"), "wall/answers.csv"),
        ((*SOLVE, "wall/answers.parquet"), "wall/answers.parquet"),
        (("scenario", "run", "pe", "--out", "wall"), "wall/outcome.json"),
        (("scenario", "show", "pe", "--out", "wall/picture.png"), "wall/picture.png"),
    ],
)
def test_what_cannot_be_written_is_named_and_is_always_the_same_exit_code(
    arguments, named, main, tmp_path, monkeypatch, capfd
):
    pytest.importorskip("matplotlib")
    pytest.importorskip("pyarrow")
    monkeypatch.chdir(tmp_path)
    Path("states.csv").write_text(STATES)
    Path("wall").write_text("no folder")
    assert main(*arguments) == errors.OutputError.exit_code
    assert f"error: {named}: cannot be written" in capfd.readouterr().err


def test_a_picture_of_an_unknown_kind_is_refused_before_it_is_drawn(main, capfd):
    pytest.importorskip("matplotlib")
    assert main("scenario", "show", "pe", "--out", "picture.foo") == errors.ConfigError.exit_code
    out, err = capfd.readouterr()
    assert out == ""
    assert ".png" in err
