import pytest

from tests import statements


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
