"""The step `mutants`: what is listed as equivalent still exists, and no function is left out of the mutation."""

import ast
from collections import Counter
from types import FunctionType

import pytest

from tests.mutants import (
    MODULE,
    ROOT,
    TESTS,
    Mutant,
    changes_letters,
    changes_of,
    faults_of,
    listed_mutants,
    undecorated,
)


def test_every_mutated_file_and_every_judging_test_exists():
    files = {*TESTS, *(test for tests in TESTS.values() for test in tests)}
    for name in files:
        file, _, test = name.partition("::")
        assert f"def {test}" in (ROOT / file).read_text(encoding="utf-8")


def test_the_line_of_every_listed_mutant_is_still_in_its_file():
    listed = listed_mutants()
    assert set(listed) <= set(TESTS)
    for name, mutants in listed.items():
        words = "".join((ROOT / name).read_text(encoding="utf-8").split())
        lost = [mutant for mutant in mutants if "".join(mutant.line.split()) not in words]
        assert lost == []


@pytest.mark.parametrize("name", TESTS)
def test_no_decorator_hides_a_function_from_mutation(name):
    source = undecorated((ROOT / name).read_text(encoding="utf-8"))
    decorated = [
        node.name
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef)
        and {ast.unparse(decorator) for decorator in node.decorator_list} - {"classmethod"}
    ]
    assert decorated == []


def test_a_property_without_its_decorator_is_one_and_a_cache_is_gone():
    source = "class A:\n    @property\n    def b(self):\n        return 1\n\n@lru_cache\ndef c(): return []\n"
    names = {}
    exec(undecorated(source), names)
    assert names["A"]().b == 1
    assert names["c"]() is not names["c"]()


SOURCE = """
LEAST = 3

class A:
    def b(self, most=2):
        return (
            1 + most
        )

def c():
    return d(LEAST) < 4
"""


def test_a_mutant_is_known_by_its_function_and_its_lines():
    mutants = {change.mutant: change for change in changes_of(SOURCE)}
    assert set(mutants) == {
        Mutant(MODULE, "LEAST = 3", "LEAST = 4"),
        Mutant("A.b", "def b(self, most=2):", "def b(self, most=3):"),
        Mutant("A.b", "1 + most", "2 + most"),
        Mutant("A.b", "1 + most", "1 - most"),
        Mutant("c", "return d(LEAST) < 4", "return d(None) < 4"),
        Mutant("c", "return d(LEAST) < 4", "return d(LEAST) <= 4"),
        Mutant("c", "return d(LEAST) < 4", "return d(LEAST) < 5"),
    }
    for mutant, change in mutants.items():
        assert mutant.becomes in change.source()
        # A default is computed with the module, not with its function.
        assert (change.code is None) is ("LEAST =" in mutant.line or "most=" in mutant.line)
    swapped = FunctionType(mutants[Mutant("A.b", "1 + most", "1 - most")].code, {})
    assert swapped(None, 3) == -2


def test_a_survivor_has_to_be_listed_and_a_listed_mutant_has_to_survive():
    first = Mutant("f", "a < b", "a <= b")
    second = Mutant("f", "a < b", "a > b")

    def faults(survivors, listed):
        return len(list(faults_of("file", Counter([first, second]), survivors, listed, whole=True)))

    assert faults([first], [first]) == 0
    assert faults([first, second], [first]) == 1
    assert faults([], [first]) == 1
    assert faults([], [Mutant("f", "gone", "gone for good")]) == 1
    assert faults([first], [first, first]) == 1


@pytest.mark.parametrize(
    ("becomes", "only_letters"),
    [
        ('f("key", "XXsome wordsXX")', True),
        ('f("key", "SOME WORDS")', True),
        ('f("KEY", "some words")', False),
        ('f("key", None)', False),
        ('f("some words")', False),
    ],
)
def test_only_texts_for_people_may_change_unnoticed(becomes, only_letters):
    assert changes_letters(Mutant("f", 'f("key", "some words")', becomes)) is only_letters
