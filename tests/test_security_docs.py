"""docs/security.md is promises with their tests: each sentence that promises is one row, and its tests exist."""

import re
from pathlib import Path

import pytest

from tests.faults import drawing, teams

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
HEADINGS = ("| can try |", "| what |", "|---|")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in TEXT.splitlines()
    if line.startswith("|") and not line.startswith(HEADINGS)
]
PROSE = [
    " ".join(paragraph.split())
    for paragraph in TEXT.split("\n\n")
    if not paragraph.startswith(("|", "#"))
]
TESTS = {
    name
    for path in (ROOT / "tests").rglob("test_*.py")
    for name in re.findall(r"^ *(?:async )?def (test_\w+)", path.read_text(encoding="utf-8"), re.M)
}
KINDS = {*drawing.KINDS, *teams.KINDS}


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[1][:50])
def test_every_promise_is_one_sentence_with_tests_that_exist(row):
    _, promise, tests = row
    assert promise
    assert ". " not in promise
    assert ";" not in promise
    named, _, kinds = tests.partition("fault flights")
    names = re.findall(r"`([^`]+)`", named)
    flown = re.findall(r"`([^`]+)`", kinds)
    assert names or flown
    assert set(names) <= TESTS
    assert set(flown) <= KINDS
    assert bool(flown) == ("fault flights" in tests)


def test_no_sentence_outside_the_tables_promises_anything():
    """It says how to read the page, what is assumed, or what is not prevented."""
    _, assumed, *others = PROSE
    assert assumed.startswith("**Assumed.**")
    assert [paragraph for paragraph in others if not paragraph.startswith("Not prevented: ")] == []


def test_the_tables_are_read():
    assert len(ROWS) > 75
