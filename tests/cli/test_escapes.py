"""What strangers wrote commands no terminal: titles of files, messages of an autopilot, answers of daemons."""

import io

import pytest
from rich.text import Text
from typer.testing import CliRunner

from guidance.cli.fly import LiveLine
from guidance.cli.program import app
from guidance.config import find
from guidance.flight import State
from guidance.screen import PrintableConsole, text_table, waiting
from guidance.session.fly.mission import Progress

EVIL = "\x1b]0;owned [/bold] [red]x[/red] :smile: \u202eabc"
SHOWN = "\\x1b]0;owned [/bold] [red]x[/red] :smile: \\u202eabc"
TITLE = 'title = "\\u001b]0;owned [/bold] [red]x[/red] :smile: \\u202eabc"'


def written_by(file, kind, path):
    """Copy a bundled file with a hostile title."""
    lines = find(file, kind).read_text().splitlines()
    lines = [TITLE if line.startswith("title =") else line for line in lines]
    path.write_text("\n".join(lines))
    return str(path)


def screen():
    written = io.StringIO()
    return PrintableConsole(file=written, width=200, markup=False, emoji=False), written


@pytest.mark.parametrize("words", [["scenario", "run"], ["scenario", "show"]])
def test_the_title_of_a_scenario_is_printed_as_text(tmp_path, words):
    path = written_by("pe", "scenarios", tmp_path / "evil.toml")
    done = CliRunner().invoke(app, [*words, path])
    assert done.exit_code == 0
    assert SHOWN in done.output
    assert "\x1b]" not in done.output


def test_the_title_of_a_sweep_is_printed_as_text(tmp_path):
    pytest.importorskip("pyarrow")
    path = written_by("barrier", "sweeps", tmp_path / "evil.toml")
    text = (tmp_path / "evil.toml").read_text().replace("seeds = 40", "seeds = 1")
    (tmp_path / "evil.toml").write_text(text)
    command = ["sweep", "run", path, "--out", str(tmp_path / "out"), "--workers", "1"]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    assert SHOWN in done.output
    assert "\x1b]" not in done.output


def test_a_message_of_the_autopilot_is_printed_as_text():
    there, written = screen()
    line = LiveLine(there)
    line.show(Progress(1.0, State.CHECKING, "HOLD", None, "s", waiting=f"autopilot says {EVIL}"))
    line.show(Progress(2.0, State.YIELDED, "HOLD", None, "s", why=EVIL))
    with waiting(there, EVIL, 5.0) as tell:
        tell(EVIL)
    there.print(text_table((EVIL, "b"), [(EVIL, Text(EVIL))], title=EVIL))
    assert written.getvalue().count("\\x1b]0;owned [/bold] [red]x[/red]") >= 5
    assert "\x1b" not in written.getvalue()
    assert "\u202e" not in written.getvalue()
