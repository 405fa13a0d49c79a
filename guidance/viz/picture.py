"""The flight as a picture: both tracks in space and from above, where the game began and where it was to end."""

import contextlib
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from guidance.files import private_file
from guidance.flight import State
from guidance.frames import Vector
from guidance.session.result import FlightResult, ending_words
from guidance.session.spec import plan_of
from guidance.sim.outcome import Outcome
from guidance.viz.chase import Chase, draw_chase, draw_fence
from guidance.viz.figures import label_plan, label_space, legend_below, literal, save, space_and_plan
from guidance.viz.shapes import Array, circle, isochron_at


def draw(result: FlightResult, outcome: Outcome, path: Path) -> None:
    """Draw the flight into a PNG.

    Raises:
        OutputError: If the file cannot be written.
    """
    figure, space, plan = space_and_plan()
    chase = chase_of(result)
    for axes, dimensions in ((space, 3), (plan, 2)):
        draw_chase(axes, chase, dimensions)
    label_plan(plan)
    for axes, dimensions in ((space, 3), (plan, 2)):
        draw_fence(axes, chase.fence, chase.fence_height_m, dimensions)
    label_space(space)
    figure.suptitle(literal(f"{outcome.scenario}: {ending_words(outcome)}, {_score(outcome)}"))
    legend_below(figure, plan)
    with contextlib.suppress(OSError):  # `save` says what cannot be written
        private_file(path)
    save(figure, path)


def chase_of(result: FlightResult) -> Chase:
    """Return what is drawn of a flight: the game is from the engagement until the landing begins."""
    scenario = result.scenario
    playing = {State.ENGAGED, State.PAUSED, State.ON_STATION}
    samples = result.samples
    begun = next((place for place, one in enumerate(samples) if one.state in playing), len(samples))
    ended = next((place for place in range(begun, len(samples)) if samples[place].state not in playing), len(samples))
    settings = plan_of(scenario=scenario).flight.cycle
    engaged = None if result.engaged is None or result.engaged.no_game else result.engaged
    home_x, home_y = scenario.home_m
    return Chase(
        (_places(one.pursuer_m for one in samples[:begun]), _places(one.pursuer_m for one in samples[ended:])),
        _places(one.pursuer_m for one in samples[begun:ended]),
        _places(one.evader_m for one in samples[begun:ended]),
        settings.standoff,
        reached_m=next((one.evader_m for one in samples if one.state is State.ON_STATION), None),
        isochron=None if engaged is None else isochron_at(settings, engaged),
        meeting_m=None if engaged is None else (*engaged.meeting_point_game_m[:2], 0.0),
        target_m=settings.target_game_m,
        fence=(circle((home_x, home_y, 0.0), scenario.limits.fence_radius_m, 361),),
    )


def _places(places: Iterable[Vector]) -> Array:
    return np.array(list(places)).reshape(-1, 3)


def _score(outcome: Outcome) -> str:
    unit = "s" if outcome.game == "pe" else "m from T"
    if math.isnan(outcome.achieved):
        return "no game was played" if math.isnan(outcome.predicted) else f"{outcome.predicted:.2f} {unit} predicted"
    return f"{outcome.achieved:.2f} {unit} flown, {outcome.predicted:.2f} {unit} predicted"
