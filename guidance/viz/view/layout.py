"""How the viewer's window is divided: the game in space, the plots beside it, the events below."""

import rerun.blueprint as rrb

from guidance.viz.view import names
from guidance.viz.view.painter import TIMELINE
from guidance.viz.view.plots import PLOTS


def layout(*, with_target: bool) -> rrb.Blueprint:
    """Return the blueprint; `with_target` names the guarantee's unit."""
    until_now = rrb.VisibleTimeRanges(
        timeline=TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    space = rrb.Spatial3DView(
        origin="game",
        name="The game: x east, y north, z up, m",
        eye_controls=rrb.EyeControls3D(
            position=(55.0, -85.0, 60.0), look_target=(0.0, 10.0, 8.0), eye_up=(0.0, 0.0, 1.0)
        ),
        overrides={f"{name}/track": until_now for name in (names.PURSUER, names.EVADER)},
    )
    guarantee = "Guarantee L, m from T" if with_target else "Guarantee V + t, s"
    plots = [rrb.TimeSeriesView(origin=plot.path, name=plot.title) for plot in PLOTS]
    plots.insert(2, rrb.TimeSeriesView(origin=names.GUARANTEE, name=guarantee))
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(space, rrb.TextLogView(origin=names.EVENTS, name="Events"), row_shares=[3, 1]),
            rrb.Vertical(*plots),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )
