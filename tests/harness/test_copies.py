"""A copy of a world flies exactly as the original, and neither affects the other. Many tests rely on this."""

import threading

import pytest

from sitl_mock import MockVehicle
from tests.harness.copies import Flown, copied, shared_by_functions
from tests.harness.sortie import Stepped


def wire(sortie):
    return [(sent.now_s, bytes(sent.message.get_msgbuf())) for sent in sortie.sent]


@pytest.mark.parametrize("autopilot", ["px4", pytest.param("arducopter", marks=pytest.mark.long)])
def test_a_copied_sortie_flies_on_as_the_one_it_was_copied_from(autopilot):
    """Catches state of a flight that two copies share, so that one test changes another."""
    first = Stepped(autopilot).standing_by()
    before = first.now_s
    copy = copied(first, first.history())
    untouched = copied(first, first.history())
    copy.mock.inject("wind_m_s", (3.0, 0.0, 0.0))
    copy.run(2.0)
    assert (first.now_s, first.mock.truth) == (before, untouched.mock.truth)
    first.run(2.0)
    untouched.run(2.0)
    assert wire(untouched) == wire(first)
    assert untouched.mock.truth == first.mock.truth != copy.mock.truth
    for one in (first, copy, untouched):
        one.close()


@pytest.mark.parametrize("flavour", ["px4", "arducopter", "rover"])
def test_no_function_of_a_vehicle_holds_on_to_the_one_it_was_made_in(flavour):
    assert shared_by_functions(MockVehicle(flavour)) == set()


def test_nor_does_one_of_a_whole_sortie():
    """Catches a closure that keeps an object of the original in a copied sortie."""
    sortie = Stepped("px4").engaged()
    assert shared_by_functions(sortie) == set()
    assert shared_by_functions([[], lambda: sortie, sortie]) == {
        f"{__name__}.{test_nor_does_one_of_a_whole_sortie.__name__}.<locals>.<lambda>"
    }
    sortie.close()


def test_each_kind_is_flown_once_and_what_is_handed_out_is_never_the_same():
    flown = Flown()
    made = []

    def fly():
        made.append({"lock": threading.Lock(), "states": [1]})
        return made[-1]

    one = flown("a", fly)
    other = flown("a", fly)
    one["states"].append(2)
    with one["lock"]:
        assert not other["lock"].locked()
    assert (len(made), other["states"]) == (1, [1])
    flown("b", fly)
    assert len(made) == 2
