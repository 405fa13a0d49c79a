"""Row 26 with parameters: every command of MAVLink's dialects, asked with ones, NaN, and zeros in a COMMAND_INT.

`tests/data/command_answers.json` has the real autopilots' answers on the ground, disarmed and ready to arm.
"""

import json
import math
from pathlib import Path

import pytest

REAL = json.loads((Path(__file__).parents[2] / "data" / "command_answers.json").read_text())
PARAMETERS = {"ones": 1.0, "nans": math.nan, "zeros as integers": 0.0}

NO_ID = "NaN is no message id and is denied, where PX4 makes a number of it"
DEPARTURES = {
    ("px4", "ones", 511): "SYS_STATUS every microsecond is accepted, at the fastest rate there is",
    ("px4", "nans", 510): NO_ID,
    ("px4", "nans", 511): NO_ID,
    ("px4", "nans", 512): NO_ID,
    ("px4", "nans", 400): "NaN is not taken for an order to disarm",
    ("arducopter", "ones", 300): "MISSION_START looks at no items",
    ("arducopter", "ones", 401): "the checks are run without waiting for the next ones",
    (
        "arducopter",
        "ones",
        42424,
    ): "a compass is always there to be calibrated, whatever the mask says",
    ("arducopter", "ones", 42425): "there is never anything to be stored",
}
"""Answers that differ on purpose, each with its reason."""


UNSUPPORTED = [3]


def asked(flight, kind, number):
    """Answers of a mock."""
    value = PARAMETERS[kind]
    if kind.endswith("integers"):
        return flight.command_int(number, 3, *[value] * 4)
    return flight.command(number, *[value] * 7, wait_s=0.06)


@pytest.mark.parametrize(
    ("flavour", "kind"), [(flavour, kind) for flavour, kinds in REAL.items() for kind in kinds]
)
def test_row_26_every_command_is_answered_as_the_real_one_does(fly, flavour, kind):
    """Catches a command that is answered otherwise than by the real autopilot.

    What is unsupported changes nothing, so one vehicle is asked for all of it.
    """

    def fresh():
        return fly(flavour, ready_after_s=0.1).run(0.3)

    same = fresh()
    different = {}
    for group in REAL[flavour][kind]:
        for number in group["commands"]:
            found = asked(same if group["answers"] == UNSUPPORTED else fresh(), kind, number)
            if found != group["answers"]:
                different[flavour, kind, number] = (found, group["answers"])
    assert different.keys() == {each for each in DEPARTURES if each[:2] == (flavour, kind)}, (
        different
    )
