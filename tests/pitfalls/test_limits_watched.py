"""The limits of space hold whether or not a game is played: a vehicle that is pushed out while it hovers is told of."""

from dataclasses import replace

import pytest

from guidance.flight import Event, State
from guidance.frames import Ned
from guidance.messages import LocalPosition

pytestmark = pytest.mark.flight


def close_by(flight, limit):
    """Draw one limit of the flight: the fence at a metre about the vehicle, the heights a little beyond it."""
    north_m, east_m, down_m = flight.flight.vehicle.latest.get(LocalPosition).position_ned_m
    envelope = flight.flight.observed.cycle.envelope
    _, _, home_down_m = envelope.home_ned_m
    height_m = home_down_m - down_m
    change = {
        Event.FENCE: {
            "home_ned_m": Ned((north_m, east_m, home_down_m)),
            "fence_radius_m": 1.0,
            "fence_margin_m": 0.0,
        },
        Event.FLOOR: {"floor_m": height_m + 0.7},
        Event.CEILING: {"ceiling_m": height_m - 0.7, "floor_m": 0.0},
    }[limit]
    flight.flight.observed.cycle = replace(
        flight.flight.observed.cycle, envelope=replace(envelope, **change)
    )


@pytest.mark.parametrize(
    ("limit", "state"),
    [
        (Event.FENCE, State.ON_STATION),
        (Event.FLOOR, State.PAUSED),
        (Event.CEILING, State.ON_STATION),
    ],
)
def test_a_vehicle_that_hovers_beyond_a_limit_is_told_of_and_handed_to_its_hold(
    sortie, autopilot, limit, state
):
    if state is State.ON_STATION:
        flight = sortie.on_station(autopilot)
    else:
        flight = sortie.engaged(autopilot).run(2.0)
        flight.world.evaders["pursuer"]["evader"].receive = lambda: ()
        silent = flight.now_s
        flight.until(state, limit_s=3.0)
        assert flight.now_s - silent < 3.0
    flight.run(1.0)
    close_by(flight, limit)
    flight.mock.inject("wind_m_s", (12.0, 0.0, 0.0))
    flight.until(State.HOLDING, limit_s=4.0)
    assert flight.events[-1] is limit
