"""The present code sends the same commands for the inputs of a flight that was recorded earlier.

A record made by the same machine is replayed bit for bit (test_replay). This one may come from another processor, whose
sines differ in the last bit: 1e-9 m/s is allowed, another state or request is not. After an intended change of
behaviour, `python tests/log/golden.py` writes it again.
"""

from pathlib import Path

import pytest

from guidance.log import replay, survey_of
from guidance.log.codec import plain
from guidance.session.flight_files import recorded_settings

GOLDEN = Path(__file__).parents[1] / "data" / "short_chase.mcap"


def test_the_golden_flight_gives_the_recorded_commands():
    """Catches commands that have changed since the golden flight."""
    commanded = 0
    for step in replay(GOLDEN, recorded_settings):
        at = f"at {step.row.now_s:.2f} s, in {step.row.state}"
        assert str(step.outputs.state) == step.row.state, at
        assert len(step.outputs.requests) == len(step.row.requests), at
        setpoint = step.row.setpoint
        now = step.outputs.setpoint
        assert (setpoint is None) == (now is None), at
        if setpoint is not None and now is not None:
            commanded += 1
            assert flat(now) == pytest.approx(flat(setpoint), abs=1e-9), at
    assert commanded > 500


def test_the_golden_flight_is_whole_and_small():
    assert survey_of(GOLDEN).torn is None
    # A fifth of it are the setpoints that PX4 echoes at 50 Hz
    assert GOLDEN.stat().st_size < 350 * 1024


def flat(setpoint):
    row = plain(setpoint)
    return [
        *row["velocity_ned_m_s"],
        *(row["acceleration_ned_m_s2"] or ()),
        *(() if row["yaw_rad"] is None else (row["yaw_rad"],)),
    ]
