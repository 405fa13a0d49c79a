"""`python -m tests`: every step has a row, what starved runs again alone, and what passed is not repeated."""

import ast
import json
import sys
from collections import defaultdict

import pytest

from tests import __main__ as steps
from tests.__main__ import FAILED, PASSED, PYTEST, ROOT, STARVED, Row, Step, costly, run
from tests.changed import changed_functions, reached


@pytest.fixture(autouse=True)
def kept(tmp_path, monkeypatch):
    """Results are kept in a folder of the test."""
    monkeypatch.setattr(steps, "KEPT", tmp_path / "kept")
    return tmp_path / "kept"


def ending(code):
    return Step("", (sys.executable, "-c", f"raise SystemExit({code})"))


def rows(out):
    """The verdict of each row of the table, and the last line."""
    lines = out.rpartition("processor  tests\n")[2].strip().splitlines()
    return {line.split()[0]: line.split()[1] for line in lines[:-1] if line}, lines[-1]


def test_every_step_has_a_row_and_the_last_line_counts_them(capfd):
    some = {"good": ending(0), "bad": ending(2), "last": ending(0)}
    assert run(some, (), [["good", "last"], ["bad"]]) == 1
    verdicts, total = rows(capfd.readouterr().out)
    assert verdicts == {"good": PASSED, "bad": FAILED, "last": PASSED}
    assert total == "2 passed, 1 failed"


def test_nothing_else_runs_if_a_first_step_fails(capfd):
    assert run({"first": ending(1), "long": ending(0)}, ("first",), [["long"]]) == 1
    assert rows(capfd.readouterr().out) == ({"first": FAILED}, "0 passed, 1 failed")


@pytest.mark.parametrize(("second", "verdict"), [(0, PASSED), (1, FAILED), (3, STARVED)])
def test_what_has_no_processor_runs_again_alone_and_fails_if_it_has_none_again(
    second, verdict, tmp_path, capfd
):
    once = tmp_path / "once"
    code = f"import pathlib; once = pathlib.Path({str(once)!r})\nif once.exists(): raise SystemExit({second})\n"
    busy = Step("", (sys.executable, "-c", f"{code}once.touch(); raise SystemExit(3)"))
    assert run({"busy": busy}, (), [["busy"]]) == int(verdict != PASSED)
    assert rows(capfd.readouterr().out)[0] == {"busy": verdict}


def test_of_what_passed_before_only_skipped_tests_run(tmp_path, capfd):
    """Catches a step that runs again what has passed, or leaves out what was skipped."""
    file = tmp_path / "test_two.py"
    (tmp_path / "conftest.py").write_text("from tests.conftest import *\n")
    file.write_text("def test_passed(): raise AssertionError\ndef test_skipped(): pass\n")
    before = {
        "suite": Row(
            PASSED, tests={f"{file}::test_passed": (PASSED, 0.1), f"{file}::test_skipped": ("skipped", 0.0)}
        ),
        "check": Row(PASSED),
    }  # fmt: skip
    suite = Step("", (*PYTEST, "-c", "/dev/null", "--rootdir", "/"))
    assert run({"check": ending(1), "suite": suite}, (), [["check", "suite"]], before) == 0
    assert rows(capfd.readouterr().out)[1].startswith("3 passed, 0 failed")


def test_results_are_kept_for_all_as_long_as_no_file_changes(kept, monkeypatch):
    some = {"good": ending(0), "bad": ending(1)}
    monkeypatch.setattr(steps, "EVERY", some)
    run(some, ("good",), [["bad"]])
    assert steps.passed_before() == {"good": Row(PASSED, **times(kept, "good"))}
    monkeypatch.setattr(steps, "fingerprint", lambda: "of other files")
    assert steps.passed_before() == {}


def times(kept, name):
    row = json.loads((kept / "passed.json").read_text())["rows"][name]
    return {key: row[key] for key in ("seconds", "processor_s")}


def test_every_costly_test_says_what_only_it_catches():
    names = defaultdict(set)
    for test in costly():
        file, _, name = test.partition("::")
        names[file].add(name.partition("[")[0].rpartition("::")[2])
    silent = [
        f"{file}::{node.name}"
        for file, listed in names.items()
        for node in ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.name in listed
        and not (ast.get_docstring(node) or "").startswith("Catches ")
    ]
    assert silent == []


FILES = {
    "a/walls.py": "",
    "a/cycle.py": "from a import walls",
    "a/pages.py": "PAGE = 'page.html'",
    "tests/conftest.py": "",
    "tests/test_walls.py": "from a.walls import x",
    "tests/test_cycle.py": "def test():\n    import a.cycle",
    "tests/test_page.py": "import a.pages",
}


@pytest.mark.parametrize(
    ("changed", "tests"),
    [
        ("a/walls.py", {"test_walls": 1, "test_cycle": 2}),
        ("a/page.html", {"test_page": 2}),
        ("tests/test_walls.py", {"test_walls": 0}),
        ("tests/conftest.py", {"test_walls": 1, "test_cycle": 1, "test_page": 1}),
        ("b.py", {}),
    ],
)
def test_a_change_reaches_the_tests_that_import_it_or_name_it_nearest_first(changed, tests):
    distances = reached([changed], FILES)
    assert {
        file.removeprefix("tests/").removesuffix(".py"): distance
        for file, distance in distances.items()
        if "/test_" in file
    } == tests


def test_only_functions_that_differ_have_their_mutants_made():
    before = "def same(): return 1\nclass A:\n    def b(self): return 1\n"
    after = "def same():  # said otherwise\n    return 1\nclass A:\n    def b(self): return 2\ndef new(): pass\n"
    assert changed_functions(before, after) == ["new", "b"]
