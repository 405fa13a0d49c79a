"""A flight kept from an earlier day: what the present code commands at its moments is what was commanded then.

A record made in the test at hand must come back bit for bit (test_records_replay). This one may have been made on
another processor, whose sines differ in the last bit: a nanometre a second is allowed, another state or another request
is not. When a change of behaviour is meant, `python tests/log/golden.py` writes it again.
"""

from pathlib import Path

import pytest

from guidance.log import replay, survey_of
from guidance.log.codec import plain
from guidance.session.flight_files import recorded_settings

GOLDEN = Path(__file__).parents[1] / "data" / "short_chase.mcap"


def test_the_golden_flight_is_commanded_as_it_was():
    commanded = 0
    for step in replay(GOLDEN, recorded_settings):
        at = f"at {step.row.now_s:.2f} s, in {step.row.state}"
        assert str(step.outputs.state) == step.row.state, at
        assert len(step.outputs.requests) == len(step.row.requests), at
        setpoint, now = step.row.setpoint, step.outputs.setpoint
        assert (setpoint is None) == (now is None), at
        if setpoint is not None and now is not None:
            commanded += 1
            assert flat(now) == pytest.approx(flat(setpoint), abs=1e-9), at
    assert commanded > 500


def test_the_golden_flight_is_whole_and_small():
    assert survey_of(GOLDEN).torn is None
    assert GOLDEN.stat().st_size < 350 * 1024  # a fifth of it is the setpoint that PX4 tells, 50 times a second


def flat(setpoint):
    row = plain(setpoint)
    return [
        *row["velocity_ned_m_s"],
        *(row["acceleration_ned_m_s2"] or ()),
        *(() if row["yaw_rad"] is None else (row["yaw_rad"],)),
    ]
