"""Entity paths of a Rerun recording, and the layout of the viewer's window.

The game in space, the plots beside it, the events below.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import rerun.blueprint as rrb

from guidance.log import Cycle

PURSUER: Final = "game/pursuer"
EVADER: Final = "game/evader"
DISC: Final = "game/stand_off_disc"
ISOCHRON: Final = "game/isochron"
MEETING: Final = "game/meeting_point"
FENCE: Final = "game/fence"
TARGET: Final = "game/target"
GUARANTEE: Final = "plots/guarantee"
STATE: Final = "state"
EVENTS: Final = "events"

COLUMN: Final[Mapping[str, str]] = {PURSUER: "pursuer_m", EVADER: "evader_m"}
"""Column of a cycle with the entity's position."""

TIMELINE: Final = "flight"

Colour = tuple[int, int, int]

COLOURS: Final[Mapping[str, Colour]] = {
    PURSUER: (214, 69, 58),
    EVADER: (66, 140, 214),
    DISC: (76, 175, 80),
    ISOCHRON: (190, 190, 190),
    MEETING: (250, 214, 60),
    FENCE: (240, 150, 40),
}


class Curve(NamedTuple):
    """A number of every cycle; NaN is not drawn."""

    label: str
    colour: Colour
    of: Callable[[Cycle], float]


class Plot(NamedTuple):
    """One panel."""

    title: str
    path: str
    curves: Mapping[str, Curve]


_RED, _BLUE, _GREY = COLOURS[PURSUER], COLOURS[EVADER], (150, 150, 150)

PLOTS: Final = (
    Plot(
        "Range to the stand-off disc, m",
        "plots/range",
        {
            "ground_m": Curve("to the rim, over ground", _RED, lambda cycle: cycle.gap_m),
            "height_m": Curve("above the disc", _BLUE, lambda cycle: cycle.height_gap_m),
        },
    ),
    Plot(
        "Value to go, s",
        "plots/to_go",
        {
            "value_s": Curve("the game's pursuer", _RED, lambda cycle: cycle.meeting_time_s),
            "needed_s": Curve("this vehicle", _GREY, lambda cycle: cycle.time_needed_s),
        },
    ),
    Plot(
        "Speed, m/s",
        "plots/speed",
        {
            "flown_m_s": Curve("flown", _GREY, lambda cycle: math.hypot(*cycle.flown_ned_m_s)),
            "commanded_m_s": Curve("commanded", _RED, lambda cycle: math.hypot(*cycle.commanded_ned_m_s)),
            "wanted_m_s": Curve("wanted by the game", _BLUE, lambda cycle: math.hypot(*cycle.desired_ned_m_s)),
        },
    ),
    Plot(
        "Age of what is known, and the loop, ms",
        "plots/age",
        {
            "vehicle_ms": Curve("vehicle's position", _RED, lambda cycle: 1e3 * cycle.telemetry_age_s),
            "evader_ms": Curve("evader's last report", _BLUE, lambda cycle: 1e3 * cycle.evader_age_s),
            "late_ms": Curve("cycle began late by", _GREY, lambda cycle: 1e3 * cycle.late_s),
        },
    ),
)


def layout(*, with_target: bool) -> rrb.Blueprint:
    """Return the blueprint; `with_target` selects the guarantee's unit."""
    until_now = rrb.VisibleTimeRanges(
        timeline=TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    space = rrb.Spatial3DView(
        origin="game",
        name="The game: x east, y north, z up, m",
        eye_controls=rrb.EyeControls3D(
            position=(55.0, -85.0, 60.0), look_target=(0.0, 10.0, 8.0), eye_up=(0.0, 0.0, 1.0)
        ),
        overrides={f"{name}/track": until_now for name in (PURSUER, EVADER)},
    )
    guarantee = "Guarantee L, m from T" if with_target else "Guarantee V + t, s"
    plots = [rrb.TimeSeriesView(origin=plot.path, name=plot.title) for plot in PLOTS]
    plots.insert(2, rrb.TimeSeriesView(origin=GUARANTEE, name=guarantee))
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(space, rrb.TextLogView(origin=EVENTS, name="Events"), row_shares=[3, 1]),
            rrb.Vertical(*plots),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )
