"""The script above, flown against the mock: installing the package brings the fixture `mock_vehicle`."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import takeoff_mavsdk


@pytest.mark.slow
def test_it_flies_north_and_lands(mock_vehicle):
    vehicle = mock_vehicle("px4", ready_after_s=0.5, over=["udp"], speed=5.0)
    assert takeoff_mavsdk.main(vehicle.udp, height_m=2.5, north_s=0.4) > 1.0
