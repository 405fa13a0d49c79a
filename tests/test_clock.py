from guidance.clock import MonotonicClock, VirtualClock


def test_virtual_time_moves_by_waiting_and_never_back():
    clock = VirtualClock(5.0)
    clock.sleep_until(7.5)
    assert clock.now_s() == 7.5
    clock.sleep_until(6.0)
    assert clock.now_s() == 7.5


def test_real_time_starts_at_zero_never_falls_and_waits_no_less_than_asked():
    clock = MonotonicClock()
    start_s = clock.now_s()
    assert 0.0 <= start_s < 1.0
    clock.sleep_until(start_s + 0.01)
    assert clock.now_s() >= start_s + 0.01
    clock.sleep_until(start_s - 1.0)
