"""Feedback of the limits, the last part of a guidance cycle, to the servo of the next cycle."""

from dataclasses import replace

from guidance.autopilots import PX4
from guidance.control import Situation
from guidance.control.braking_law import measure_walls
from guidance.control.polygon import Polygon
from guidance.control.servo import SpeedMemory
from guidance.cycle import CycleInputs, CycleMemory, hover, play
from guidance.estimation import EvaderEstimate
from guidance.frames import GameFrame, Ned
from tests.flight.scenes import CYCLE, ENVELOPE

DT_S = 0.02
FOLLOWED = replace(CYCLE, handling=PX4.handling)
BEHIND = Polygon(((-50.0, -50.0), (-50.0, 50.0), (10.0, 50.0), (10.0, -50.0)))
EVADER = EvaderEstimate(Ned((60.0, 30.0, 0.0)), Ned((0.0, 3.0, 0.0)), 3.0, 0.1)


def drags_per_s(settings, place, velocity, *, cycles):
    """Return, for each cycle at one place, the learned drag and whether the limits held the vehicle back."""
    memory = CycleMemory()
    held = []
    learned = []
    here = Situation(Ned(place), Ned(velocity), evader_position_ned_m=EVADER.position_ned_m)
    walls = measure_walls(here, settings.envelope)
    for _ in range(cycles):
        memory = play(
            CycleInputs(DT_S, here, walls, EVADER, GameFrame(Ned((0.0, 0.0, 0.0)))),
            settings,
            memory,
        ).memory
        held.append(memory.limits.held_back)
        learned.append(memory.follow.servo.drag_per_s)
    return learned, held


def test_a_vehicle_that_a_fence_holds_back_learns_no_drag_of_it():
    fenced = replace(FOLLOWED, envelope=replace(ENVELOPE, fence_polygon=BEHIND, fence_margin_m=1.0))
    place = (4.0, 0.0, -20.0)
    velocity = (4.0, 2.0, 0.0)
    free, never = drags_per_s(FOLLOWED, place, velocity, cycles=100)
    assert not any(never)
    assert free[-1] > free[0] + 0.1
    learned, held = drags_per_s(fenced, place, velocity, cycles=100)
    assert any(held)
    for before, after, was_held in zip(learned, learned[1:], held, strict=False):
        assert not was_held or after == before


def test_a_hover_keeps_what_was_learned_of_the_speed_and_begins_the_comparison_again():
    learned = SpeedMemory(
        8.5, 0.85, Ned((8.4, 0.0, 0.0)), compared_s=3.0, covered_s=2.5, began_m_s=8.0
    )
    here = Situation(Ned((0.0, 0.0, -20.0)), Ned((0.0, 0.0, 0.0)))
    inputs = CycleInputs(DT_S, here, measure_walls(here, ENVELOPE), None, None)
    assert hover(inputs, CYCLE, CycleMemory(speed=learned)).memory.speed == SpeedMemory(8.5, 0.85)
