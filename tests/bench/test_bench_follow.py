"""The bench of follow modes ends in words."""

import sys

import pytest

from guidance.errors import FlightError
from tests.bench import bench_follow


def test_a_vehicle_that_is_in_the_air_is_named_and_not_a_traceback(monkeypatch):
    def in_the_air(*_args, **_named):
        raise FlightError("the vehicle is in the air")

    monkeypatch.setattr(bench_follow, "autopilot_at", in_the_air)
    monkeypatch.setattr(sys, "argv", ["bench_follow", "--px4", "udpin://127.0.0.1:14540"])
    with pytest.raises(SystemExit, match="px4: the vehicle is in the air"):
        bench_follow.main()
