"""Faults of an evader's reports, as a pursuer hears them."""

import itertools
import math

import pytest

POSITION = "GLOBAL_POSITION_INT"


def stamps(flight, name=POSITION):
    return [m.time_boot_ms for _, m in flight.all(name)]


def test_a_slow_evader_reports_in_steps_of_a_second(rig):
    flight = rig({"kind": "evader_slow"}).run(10.5)
    times = [t for t, _ in flight.all(POSITION)]
    assert [b - a for a, b in itertools.pairwise(times)] == pytest.approx([1.0] * 10, abs=0.021)
    assert len(flight.all("ATTITUDE")) > 1000


def test_reports_come_twice_with_the_same_stamp(rig):
    flight = rig({"kind": "evader_duplicates"}).run(3.0)
    came = stamps(flight)
    assert len(came) == 2 * len(set(came))


def test_reports_are_out_of_order_and_complete(rig):
    flight = rig({"kind": "evader_out_of_order", "probability": 0.3, "by_s": 0.1}).run(5.0)
    came = stamps(flight)
    assert came != sorted(came)
    assert len(came) == len(set(came)) > 240


@pytest.mark.parametrize(
    ("offset_s", "drift_ppm"), [(12.5, 0.0), (-0.2, 0.0), (0.0, 50_000.0), (3.0, -20_000.0)]
)
def test_the_clock_of_the_evader_is_off_by_offset_and_drift(rig, offset_s, drift_ppm):
    """Catches a clock's fault with a wrong sign or origin."""
    flight = rig(
        {"kind": "evader_clock", "offset_s": offset_s, "drift_ppm": drift_ppm, "at_s": 1.0},
        dt_s=0.01,
    )
    flight.run(11.0)
    errors = [(m.time_boot_ms * 1e-3 - t, t) for t, m in flight.all(POSITION, 1.5)]
    assert errors[0][0] == pytest.approx(offset_s + drift_ppm * 1e-6 * 0.5, abs=0.02)
    assert errors[-1][0] == pytest.approx(offset_s + drift_ppm * 1e-6 * 10.0, abs=0.02)


def test_a_stale_evader_repeats_its_last_report_old_stamp_and_all(rig):
    flight = rig({"kind": "evader_stale", "at_s": 2.0, "for_s": 2.0}).run(5.0)
    during = {bytes(m.get_payload()) for _, m in flight.all(POSITION, 2.05, 4.0)}
    assert len(during) == 1
    assert len(flight.all(POSITION, 2.05, 4.0)) > 90
    assert stamps(flight)[-1] > 4900


def test_a_silent_evader_sends_no_reports(rig):
    flight = rig({"kind": "evader_stale", "as": "silence", "at_s": 2.0}).run(5.0)
    assert stamps(flight)[-1] <= 2020
    assert flight.all("HEARTBEAT", 4.0)


def test_late_reports_are_old_when_they_come(rig):
    flight = rig({"kind": "evader_late", "delay_s": 0.8}, dt_s=0.01).run(3.0)
    assert min(t - m.time_boot_ms * 1e-3 for t, m in flight.all(POSITION)) == pytest.approx(
        0.8, abs=0.011
    )


def test_a_jump_displaces_every_report_of_position_by_the_same(rig):
    jump = {"kind": "evader_jump", "north": 30.0, "east": -40.0, "down": -5.0, "at_s": 2.0}
    flight = rig(jump).run(4.0)
    before, after = (flight.all(POSITION, *span)[0][1] for span in ((1.5, 2.0), (3.0, 4.0)))
    north_m = (after.lat - before.lat) * 1e-7 * 111_319.49
    east_m = (
        (after.lon - before.lon) * 1e-7 * 111_319.49 * math.cos(math.radians(before.lat * 1e-7))
    )
    assert (north_m, east_m, (after.alt - before.alt) * 1e-3) == pytest.approx(
        (30.0, -40.0, 5.0), abs=0.05
    )
    local_before, local_after = (
        flight.all("LOCAL_POSITION_NED", *s)[0][1] for s in ((1.5, 2.0), (3.0, 4.0))
    )
    assert local_after.x - local_before.x == pytest.approx(30.0, abs=0.01)
    assert (after.vx, after.vy) == (before.vx, before.vy)
