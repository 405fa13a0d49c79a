"""An evader that cannot be met inside the fence is not engaged, and the answer has its distance."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.autopilots import Mode
from guidance.control.limits import farthest_evader_m
from guidance.flight import EngageOn, Event, State
from guidance.session.orders.answers import refusal
from tests.flight.flown import Flown
from tests.flight.scenes import CYCLE, ENVELOPE, settings_of

REACH_M = ENVELOPE.fence_radius_m
RADIUS_M = float(CYCLE.game.standoff.radius_m)
FARTHEST_M = REACH_M + RADIUS_M + 2.0 * REACH_M * 3.0 / 6.0


@pytest.mark.parametrize("bearing_deg", [0.0, 130.0])
@pytest.mark.parametrize("distance_m", [FARTHEST_M + 3.0, 20e3, 900e3])
def test_it_is_refused_with_its_distance(distance_m, bearing_deg):
    bearing = math.radians(bearing_deg)
    flight = Flown()
    flight.evader = (distance_m * math.cos(bearing), distance_m * math.sin(bearing))
    flight.standing_by()
    flight.cycle(Event.ENGAGE)
    assert flight.state is State.STANDING_BY
    words = refusal(Event.ENGAGE, flight.flight, flight.now_s, ())
    assert (
        f"beyond {FARTHEST_M:.0f} m it cannot be met inside the fence of {REACH_M:.0f} m" in words
    )
    assert float(words.split()[3]) == pytest.approx(distance_m, rel=5e-2)


def test_one_that_can_be_met_is_engaged():
    flight = Flown()
    flight.evader = (0.0, FARTHEST_M - 5.0)
    flight.standing_by()
    flight.cycle(Event.ENGAGE)
    assert flight.state is State.ENTERING


@pytest.mark.parametrize(("distance_m", "state"), [(60.0, State.ENGAGED), (2e4, State.STANDING_BY)])
def test_a_pilots_switch_does_not_engage_one_either(distance_m, state):
    flight = Flown(settings_of(engage_on=EngageOn.PILOT_MODE))
    flight.evader = (distance_m, 0.0)
    flight.standing_by()
    flight.cycles(1.5)
    flight.mode = Mode.GUIDED
    flight.cycle(beat=True)
    assert flight.state is state


@given(
    st.floats(10.0, 1000.0),
    st.floats(1.0, 20.0),
    st.floats(0.05, 0.99),
    st.floats(0.0, 10.0),
    st.floats(0.0, 2.0 * math.pi),
    st.floats(0.0, 1.0),
)
def test_beyond_it_the_vehicle_is_at_every_point_of_its_fence_before_the_evader(
    reach_m, speed_m_s, ratio, radius_m, bearing, share
):
    evader_m_s = ratio * speed_m_s
    farthest_m = farthest_evader_m(
        reach_m, evader_speed_m_s=evader_m_s, speed_m_s=speed_m_s, standoff_radius_m=radius_m
    )
    # The evader is at the bound, north of home; the vehicle anywhere in the fence, the meeting on its edge.
    meeting = (reach_m * math.cos(bearing), reach_m * math.sin(bearing))
    vehicle = (-share * reach_m, 0.0)
    vehicle_s = math.dist(vehicle, meeting) / speed_m_s
    evader_s = (math.dist((farthest_m, 0.0), meeting) - radius_m) / evader_m_s
    assert evader_s >= vehicle_s - 1e-6
