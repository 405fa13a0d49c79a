"""What is plotted over time: which numbers of a cycle, in which panel, under which name."""

import math
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from guidance.log import Cycle
from guidance.viz.view.names import COLOURS, EVADER, PURSUER, Colour


class Curve(NamedTuple):
    """One number of every cycle; NaN is not drawn."""

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
