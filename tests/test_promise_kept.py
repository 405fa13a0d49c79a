"""Alarms in whole flights of the calibrated mock: none while all goes as promised, and soon one where it does not."""

import pytest

from guidance.monitor import Violation
from tests.bench.chase import Disturbance, altered, chase, hover_chase

pytestmark = pytest.mark.flight


AUTOPILOTS = ("px4", "arducopter")
SPEEDS_M_S = ((6.0, 3.0), (8.0, 4.0))
GUARDED_M = (40.0, 110.0)
SAID_WITHIN_S = 2.0
DISTURBED_S = 5.0

FASTER = Disturbance(DISTURBED_S, evader=1.3)
SILENT = Disturbance(DISTURBED_S, silent=True)
HELD_BACK = Disturbance(DISTURBED_S, alter=altered(drag=3.0))


def said(scenario, disturbance):
    """Return the kinds of alarm before the disturbance, and within the time in which it has to be said."""
    until_s = DISTURBED_S + SAID_WITHIN_S
    alarms = chase(scenario, disturbance=disturbance, longest_s=until_s).alarms
    before = {alarm.violation for now_s, alarm in alarms if now_s < DISTURBED_S}
    return before, {alarm.violation for _, alarm in alarms} - before


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("speeds_m_s", SPEEDS_M_S)
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_an_undisturbed_chase_raises_no_alarm_and_keeps_its_promise(autopilot, speeds_m_s, seed):
    chased = chase(hover_chase(autopilot, seed=seed, speeds_m_s=speeds_m_s))
    assert chased.alarms == []
    assert chased.flown_s < chased.needed_s


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("disturbance", [FASTER, HELD_BACK, SILENT], ids=["faster", "held back", "silent"])
@pytest.mark.parametrize("speeds_m_s", SPEEDS_M_S)
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_what_breaks_the_promise_of_a_capture_is_said_within_two_seconds(autopilot, speeds_m_s, disturbance, seed):
    before, after = said(hover_chase(autopilot, seed=seed, speeds_m_s=speeds_m_s), disturbance)
    assert before == set()
    assert after >= ({Violation.STALE} if disturbance.silent else {Violation.CAPTURE_LATER})


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_guarded_target_raises_no_alarm_while_the_evader_plays_as_declared(autopilot, seed):
    chased = chase(hover_chase(autopilot, seed=seed, target_m=GUARDED_M), station_s=2.0)
    assert chased.alarms == []
    assert chased.flown_s > 0.0


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("disturbance", [FASTER, HELD_BACK, SILENT], ids=["faster", "held back", "silent"])
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_what_brings_the_evader_closer_to_its_target_is_said_within_two_seconds(autopilot, disturbance, seed):
    before, after = said(hover_chase(autopilot, seed=seed, target_m=GUARDED_M), disturbance)
    assert before == set()
    assert after & {Violation.EVADER_CLOSER, Violation.BARRIER_LOST, Violation.STALE}
