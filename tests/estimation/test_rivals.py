"""One evader or two with one identity: one source is never taken for two, and a second source is detected."""

import math
import random
from typing import NamedTuple

import pytest

from guidance.estimation.measurement import Measurement, TrackSettings
from guidance.estimation.rivals import LASTS_S, SourceMemory, SourceReport, listen
from guidance.frames import Ned
from guidance.messages import UNKNOWN_VELOCITY, EvaderReport

SPEED_M_S = 3.0
MARGIN_M = 2.0
NOISE_M = 1.0
PERIOD_S = 0.1
FOR_S = 30.0
SETTINGS = TrackSettings(
    declared_speed_m_s=SPEED_M_S / 2.0,
    reach_m=MARGIN_M,
    position_sd_m=NOISE_M / 3.0 / math.sqrt(2.0),
)


class Said(NamedTuple):
    """One report, flat."""

    received_s: float
    sent_s: float
    true_s: float
    place_m: tuple[float, float]
    fits: bool | None
    sequence: int | None
    peer: str | None
    impostors: int | None = None
    source: str = "test"

    def as_report(self) -> SourceReport:
        north_m, east_m = self.place_m
        place = 47.0 + north_m / 111e3, 8.0 + east_m / 111e3, 400.0
        who = {"sequence": self.sequence, "peer": self.peer, "impostors": self.impostors}
        told = EvaderReport(
            self.received_s, self.sent_s, self.source, *place, UNKNOWN_VELOCITY, **who
        )
        measured = Measurement(
            self.true_s, self.received_s, Ned((north_m, east_m, 0.0)), None, 0.7, 0.3
        )
        return SourceReport(told, measured, self.fits)


def own(number, **changes):
    """Return one report of an evader that runs north, reports at 10 Hz and shares our clock."""
    at_s = PERIOD_S * number
    said = Said(
        at_s + 0.05, at_s, at_s, (SPEED_M_S * at_s, 0.0), fits=True, sequence=number % 256, peer="a"
    )
    return said._replace(**changes)


def heard(reports):
    rivals = SourceMemory()
    for report in sorted(reports, key=lambda report: report.received_s):
        rivals = listen(rivals, report.as_report(), SETTINGS)
    return rivals


def those(**changes):
    return [own(number, **changes) for number in range(int(FOR_S / PERIOD_S))]


def late():
    draw = random.Random(1)
    return [one._replace(received_s=one.received_s + draw.uniform(0.0, 0.4)) for one in those()]


def copied_across_a_clock_jump():
    """Every report arrives again 0.9 s later; the clock jumps at 15 s, and old stamps are far from the new one."""
    jump_s = 15.0
    reports = []
    for report in those(sequence=None):
        jumped_s = 400.0 if report.true_s >= jump_s else 0.0
        original = report._replace(sent_s=report.sent_s - jumped_s)
        received_s = report.received_s + 0.9
        is_old = not jumped_s and received_s > jump_s
        copy = original._replace(
            received_s=received_s, true_s=report.true_s + (400.0 if is_old else 0.0), fits=None
        )
        reports += [original, copy]
    return reports


ONE_SOURCE = {
    "as it should be": those(),
    "a number that never changes": those(sequence=0),
    "no numbers": those(sequence=None),
    "late and out of order": late(),
    "told twice": [
        one for each in those() for one in (each, each._replace(received_s=each.received_s + 0.02))
    ],
    "told twice while its clock jumps": copied_across_a_clock_jump(),
    "silent for a while": [one for one in those() if not 8.0 < one.received_s < 15.0],
    "in bursts": [
        one._replace(received_s=math.ceil(one.received_s)) for one in those(sent_s=math.nan)
    ],
    "one jump": [
        one._replace(fits=one.received_s < 10.0 or one.received_s > 10.6) for one in those()
    ],
    "a lie in velocity": [one._replace(fits=number % 10 > 3) for number, one in enumerate(those())],
    "no word on who sent it": those(peer=None),
}


@pytest.mark.parametrize("reports", ONE_SOURCE.values(), ids=ONE_SOURCE)
def test_one_source_is_not_taken_for_two(reports):
    assert heard(reports).seen_s == -math.inf


def second(**changes):
    """Reports of a second source, half a period after those of the first, in the second half of the time."""
    again = [
        one._replace(received_s=one.received_s + 0.05, true_s=one.true_s + 0.05)
        for one in those(**changes)
    ]
    return [one for one in again if one.received_s > FOR_S / 2]


TWO_SOURCES = {
    "place": second(fits=False, place_m=(-200.0, 0.0), sequence=None),
    "place, a few metres aside": [
        one._replace(fits=False, place_m=(one.place_m[0], 2.0), sequence=None) for one in second()
    ],
    "clock": [
        one._replace(sent_s=one.sent_s - 400.0, true_s=one.true_s - 400.0)
        for one in second(fits=None, sequence=None)
    ],
    "sequence": second(sequence=0),
    "sender": second(peer="b", sequence=None),
}


def relayed(mate, begin_s):
    """Return the reports of one evader as a mate relays them, without a time of their own."""
    untimed = those(sent_s=math.nan, sequence=None, peer=None, source=f"{mate}: test")
    return [one for one in untimed if one.received_s >= begin_s]


def test_mates_that_begin_to_relay_the_same_evader_are_no_second_source():
    reports = relayed("alpha", 0.0) + relayed("bravo", 15.0) + relayed("charlie", 16.0)
    assert heard(reports).seen_s == -math.inf


def test_a_second_source_behind_one_relay_is_detected_by_its_rate():
    more = [
        one._replace(received_s=one.received_s + 0.01 * share)
        for one in relayed("alpha", 15.0)
        for share in range(1, 4)
    ]
    assert heard(relayed("alpha", 0.0) + more).why == "rate"


@pytest.mark.parametrize("by", TWO_SOURCES)
def test_a_second_source_is_detected_by_its_contradiction_within_two_seconds(by):
    reports = those() + TWO_SOURCES[by]
    soon = [one for one in reports if one.received_s <= FOR_S / 2 + 2.0]
    assert heard(soon).why == by.split(",")[0]
    rivals = heard(reports)
    assert rivals.there(FOR_S)
    assert not rivals.there(FOR_S + 0.2 + LASTS_S)


def test_a_second_source_without_times_is_detected_by_the_rate():
    untimed = {"sent_s": math.nan, "sequence": None, "peer": None}
    more = [
        one._replace(received_s=one.received_s + 0.01 * share)
        for one in second(**untimed)
        for share in range(3)
    ]
    assert heard(those(**untimed) + more).why == "rate"


def test_alternating_reports_of_another_address_are_a_second_source():
    steady = [own(number, impostors=1) for number in range(50)]
    assert heard(steady).why == "sender"


def test_an_evader_that_moves_to_another_address_once_is_one_source():
    moved = [own(number, impostors=30 if number == 60 else None) for number in range(200)]
    moved[61] = moved[61]._replace(impostors=1)  # reordered on the way
    assert heard(moved).seen_s == -math.inf
    restarted = [own(number, peer="a" if number < 100 else "b") for number in range(200)]
    assert heard(restarted).seen_s == -math.inf
