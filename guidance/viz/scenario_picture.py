"""Pictures of a scenario: as the mathematics plays it, and as it was flown."""

import contextlib
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from guidance.files import private_file
from guidance.flight import State
from guidance.frames import Vector
from guidance.session.plan import plan_of
from guidance.session.result import FlightResult, ending_words
from guidance.sim.batch import stack, starts
from guidance.sim.maths import game_of, moments, opening
from guidance.sim.outcome import Outcome
from guidance.sim.players import evader_strategy, pursuer_strategy, speed_set, standoff, target_game_m
from guidance.sim.scenario import Scenario
from guidance.viz.figures import (
    COURSE,
    EVADER,
    ISOCHRON,
    MEETING,
    PURSUER,
    TARGET,
    Chase,
    draw_chase,
    draw_fence,
    draw_place,
    draw_standoff,
    label_plan,
    label_space,
    legend_below,
    lifted,
    save,
    space_and_plan,
)
from guidance.viz.shapes import Array, circle, isochron, isochron_at

_POINTS_A_STEP = 8


def draw_scenario(scenario: Scenario, path: Path) -> None:
    """Draw a scenario into a PNG.

    Raises:
        OutputError: If the file cannot be written.
    """
    figure, space, plan = space_and_plan()
    played_s, *tracks = played(scenario)
    for axes, dimensions in ((space, 3), (plan, 2)):
        _players(axes, scenario, tracks, dimensions)
        _geometry(axes, scenario, dimensions)
    _courses(plan, scenario, 2.0 * played_s)
    label_space(space)
    space.locator_params(axis="z", nbins=3)
    label_plan(plan)
    home_x, home_y = scenario.home_m
    draw_fence(plan, [circle((home_x, home_y, 0.0), scenario.limits.fence_radius_m, 361)], 0.0, 2)
    figure.suptitle(scenario.title)
    legend_below(figure, plan)
    save(figure, path)


def played(scenario: Scenario) -> tuple[float, Array, Array]:
    """Play a scenario as mathematics; return the duration (s) and both tracks, (n, 3), m.

    A step may be long. Hermite's cubic draws it from the positions and velocities at both ends.
    """
    steps = list(moments([scenario]))
    after = [*steps[1:], steps[-1]]
    now_s = np.array([step.now_s[0] for step in steps])
    pursuer = _curved(now_s, [step.pursuer_m[0] for step in steps], [step.flown_m_s[0] for step in after])
    evader = _curved(now_s, [step.evader_m[0] for step in steps], [step.run_m_s[0] for step in after])
    return float(now_s[-1]), pursuer, evader


def _curved(now_s: Array, places: Sequence[Array], rates: Sequence[Array]) -> Array:
    """Return a track through places (m), with more points between them; the rates (m/s) are those of the steps."""
    places_m, rates_m_s = np.array(places), np.array(rates)
    s = np.arange(_POINTS_A_STEP)[None, :, None] / _POINTS_A_STEP
    run = np.diff(now_s)[:, None, None] * rates_m_s[:, None][:-1]
    later = np.diff(now_s)[:, None, None] * rates_m_s[:, None][1:]
    begin, way = places_m[:-1, None], np.diff(places_m, axis=0)[:, None]
    curved = begin + s * way + s * (1.0 - s) * ((1.0 - s) * (run - way) - s * (later - way))
    return np.concatenate([curved.reshape(-1, 3), places_m[-1:]])


def _players(axes: Any, scenario: Scenario, tracks: Sequence[Array], dimensions: int) -> None:  # noqa: ANN401
    begun = starts([scenario])
    for name, style, track, start in zip("PE", (PURSUER, EVADER), tracks, begun, strict=True):
        axes.plot(*track[:, :dimensions].T, **style, label=f"{name} in mathematics")
        axes.plot(*start[:, :dimensions].T, "o", color=style["color"], label=f"{name} at engagement")
    end = tracks[1][-1]
    draw_standoff(axes, standoff(scenario), (float(end[0]), float(end[1]), 0.0), dimensions, "stand-off disc")


def _geometry(axes: Any, scenario: Scenario, dimensions: int) -> None:  # noqa: ANN401
    P, E = (_vector(start[0]) for start in starts([scenario]))
    batch = stack([scenario])
    curve = isochron(game_of(batch, batch.believed_m_s), P, E)
    axes.plot(*lifted(curve, 0.0, dimensions), **ISOCHRON, label="isochron")
    meeting = opening([scenario]).meeting_point_m[0]
    if np.isfinite(meeting).all():
        draw_place(axes, (float(meeting[0]), float(meeting[1]), 0.0), MEETING, dimensions, "predicted meeting")
    target = target_game_m(scenario)
    if target is not None:
        draw_place(axes, target, TARGET, dimensions, "T, target")


def _courses(plan: Any, scenario: Scenario, until_s: float) -> None:  # noqa: ANN401
    """Draw the players' courses, and no more of them than the game needs: some go on for minutes."""
    P, E = starts([scenario])
    for name, strategy in (
        ("P", pursuer_strategy(scenario, P[0], speed_set(scenario), scenario.seed)),
        ("E", evader_strategy(scenario, E[0], scenario.evader.speed_m_s, scenario.seed)),
    ):
        if strategy.course is not None:
            within = np.concatenate([[True], strategy.course.times_s[:-1] <= until_s])
            places = strategy.course.places_m[within]
            plan.plot(*places[:, :2].T, **COURSE, label=f"course of {name}")


def _vector(place: Array) -> Vector:
    x, y, z = (float(part) for part in place)
    return (x, y, z)


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
    figure.suptitle(f"{outcome.scenario}: {ending_words(outcome)}, {_score(outcome)}")
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
