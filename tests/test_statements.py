from pathlib import Path

import pytest

from tests import private_names, statements


@pytest.mark.parametrize(
    "statement",
    [
        "a, b = 1, 2",
        "age_s, name = vehicle.age_s, label(vehicle)",
        "self.a, self.b = None, None",
        "(a, b), c = point, 3",
        "a = b, c = x, y",
    ],
)
def test_packed_values_are_noticed(statement):
    assert list(statements.packed_lines(f"pass\n{statement}")) == [2]


@pytest.mark.parametrize(
    "statement",
    ["x, y = point", "low, high = high, low", "a, b = b, a + b", "x, *rest = row", "pair = x, y"],
)
def test_taking_apart_and_changing_together_are_allowed(statement):
    assert not list(statements.packed_lines(statement))


@pytest.mark.parametrize(
    ("use", "found"),
    [
        ("flight._stage.state = 3", ["_stage"]),
        ("from guidance.cli.fly import _stage", ["_stage"]),
        ('monkeypatch.setattr("guidance.flight._stage", 3)', ["_stage"]),
        ("self._stage = memory._replace(since_s=3)", []),
        ("flight.stage.state = 3", []),
    ],
)
def test_a_private_name_of_a_package_is_noticed(use, found):
    assert [name for _, name in private_names.used_lines(use, {"_stage"})] == found


def test_tests_use_public_names():
    """Catches a test that reads a private name of the packages."""
    names = private_names.private_names()
    assert len(names) > 1000
    uses = [
        f"{path}:{line}: {name}"
        for path in sorted(Path(__file__).parent.rglob("*.py"))
        for line, name in private_names.used_lines(path.read_text(encoding="utf-8"), names)
    ]
    assert uses == []
