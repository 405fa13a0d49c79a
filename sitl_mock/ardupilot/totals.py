"""How many items each plan has, as parameters that change by themselves (measured on ArduCopter 4.5.7).

A mission's and the rally points' number is told by PARAM_VALUE where it has changed; the fence's after every upload.
The fence counts as old ground stations did: vertices, circles, and two more (return point and closing vertex) where
there is a polygon, and nothing at all where there is none.
"""

from collections.abc import Sequence

from sitl_mock.protocols import PlanItem, PlanKind, PlanStore
from sitl_mock.protocols.plan import CIRCLES, POLYGONS
from sitl_mock.vehicle_state import Severity, VehicleState


def tell_totals(state: VehicleState, plans: PlanStore) -> None:
    """Count what has been uploaded or cleared since the last call."""
    for kind in sorted(plans.news):
        items = plans.plans[kind].items
        name, total = _NAMES[kind], fence_total(items) if kind is PlanKind.FENCE else len(items)
        if kind is PlanKind.MISSION and items:
            state.say(Severity.INFO, "Flight plan received")
        if kind is PlanKind.FENCE:
            state.say(Severity.DEBUG, "Fence Indexed OK")
        if kind is PlanKind.FENCE or state.parameters[name] != total:
            state.parameters.set(name, total)
            state.parameter_news.append(name)
    plans.news.clear()


def fence_total(items: Sequence[PlanItem]) -> int:
    """FENCE_TOTAL for the items of a fence."""
    vertices = sum(item.command in POLYGONS for item in items)
    return vertices + sum(item.command in CIRCLES for item in items) + 2 if vertices else 0


_NAMES = {PlanKind.MISSION: "MIS_TOTAL", PlanKind.FENCE: "FENCE_TOTAL", PlanKind.RALLY: "RALLY_TOTAL"}
