"""docs/security.md names a test for every attack in its tables, and each of these tests exists."""

import re
from pathlib import Path

import pytest

from tests.faults import drawing, teams

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in TEXT.splitlines()
    if line.startswith("|") and not line.startswith("|---")
]
ATTACKS = [row for row in ROWS if row[0] != "can try"]
NAMES = {path.name for path in (ROOT / "tests").rglob("test_*.py")}
KINDS = {*drawing.KINDS, *teams.KINDS}


@pytest.mark.parametrize("row", ATTACKS, ids=lambda row: row[0][:40])
def test_every_attack_has_tests_that_exist(row):
    attack, protection, tests = row
    if protection.startswith("as on the radio link"):
        return
    named = re.findall(r"`([^`]+)`", tests)
    if tests.startswith("same"):
        before = ATTACKS[ATTACKS.index(row) - 1]
        named += re.findall(r"`([^`]+)`", before[2])
    assert named or "fault flights" in tests, attack
    for name in named:
        if name.endswith(".py"):
            assert (ROOT / name).exists() or name in NAMES, name
        else:
            assert name in KINDS, name


def test_the_tables_are_read():
    assert len(ATTACKS) > 25
