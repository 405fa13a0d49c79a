"""The flight as a picture: both tracks in space and from above, where the game began and where it was to end."""

from pathlib import Path
from typing import Any

import numpy as np

from guidance.flight import State
from guidance.frames import Vector
from guidance.session.result import FlightResult, ending_words
from guidance.sim.outcome import Outcome
from guidance.sim.players import game, target_game_m
from guidance.viz.figures import (
    BEFORE,
    EVADER,
    ISOCHRON,
    MEETING,
    PURSUER,
    TARGET,
    draw_place,
    draw_standoff,
    label_plan,
    label_space,
    legend_below,
    lifted,
    literal,
    save,
    space_and_plan,
)
from guidance.viz.shapes import Array, isochron


def draw(result: FlightResult, outcome: Outcome, path: Path) -> None:
    """Draw the flight into a PNG.

    Raises:
        OutputError: If the file cannot be written.
    """
    figure, space, plan = space_and_plan()
    before, playing = _split(result)
    for axes, dimensions in ((space, 3), (plan, 2)):
        _tracks(axes, before, playing, dimensions)
        _geometry(axes, result, dimensions)
    label_space(space)
    label_plan(plan)
    figure.suptitle(literal(f"{outcome.scenario}: {ending_words(outcome)}, {_score(outcome)}"))
    legend_below(figure, plan)
    save(figure, path)


def _split(result: FlightResult) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Tracks (n, 3) of pursuer and evader before the engagement, and from it on until the landing begins."""
    playing = {State.ENGAGED, State.PAUSED, State.ON_STATION}
    rows = [(sample.state in playing, sample.pursuer_m, sample.evader_m) for sample in result.samples]
    begun = next((index for index, row in enumerate(rows) if row[0]), len(rows))
    ended = next((index for index in range(begun, len(rows)) if not rows[index][0]), len(rows))

    def tracks(part: list[tuple[bool, Vector, Vector]]) -> tuple[Array, Array]:
        return (
            np.array([row[1] for row in part]).reshape(-1, 3),
            np.array([row[2] for row in part]).reshape(-1, 3),
        )

    return tracks(rows[:begun]), tracks(rows[begun:ended])


def _tracks(axes: Any, before: tuple[Array, Array], playing: tuple[Array, Array], dimensions: int) -> None:  # noqa: ANN401 - 2D or 3D axes
    axes.plot(*before[0][:, :dimensions].T, **BEFORE, label="pursuer before")
    for track, style, name in ((playing[0], PURSUER, "pursuer"), (playing[1], EVADER, "evader")):
        run, letter = track[:, :dimensions], name[0].upper()
        axes.plot(*run.T, **style, label=name)
        if len(track):
            axes.plot(*run[:1].T, "o", color=style["color"], label=f"{letter} at engagement")
            axes.plot(*run[-1:].T, "s", mfc="white", color=style["color"], label=f"{letter} at the end")


def _geometry(axes: Any, result: FlightResult, dimensions: int) -> None:  # noqa: ANN401
    scenario = result.scenario
    if result.engaged_pursuer_m is not None and result.engaged_evader_m is not None:
        curve = isochron(game(scenario), result.engaged_pursuer_m, result.engaged_evader_m)
        axes.plot(*lifted(curve, 0.0, dimensions), **ISOCHRON, label="isochron at engagement")
    if result.meeting_point_m is not None:
        x, y, _ = result.meeting_point_m
        name = "q*" if scenario.target is None else "g*"
        draw_place(axes, (x, y, 0.0), MEETING, dimensions, f"{name}, meeting point")
    ends = [sample for sample in result.samples if sample.state is State.ON_STATION]
    if ends:
        draw_standoff(axes, game(scenario).standoff, ends[0].evader_m, dimensions, "stand-off disc")
    target = target_game_m(scenario)
    if target is not None:
        draw_place(axes, target, TARGET, dimensions, "T, target")


def _score(outcome: Outcome) -> str:
    unit = "s" if outcome.game == "pe" else "m from T"
    return f"{outcome.achieved:.2f} {unit} flown, {outcome.predicted:.2f} {unit} predicted"
