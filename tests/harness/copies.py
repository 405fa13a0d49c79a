"""Copies worlds in virtual time: a flight flown once continues from any number of copies, bit for bit the same."""

import copy
import copyreg
import gc
import threading
from collections.abc import Callable, Hashable, Iterable, Iterator
from contextlib import contextmanager
from operator import itemgetter
from struct import Struct
from types import FunctionType, MappingProxyType, ModuleType
from typing import Any, TypeVar

from guidance.autopilots.description import Version
from guidance.autopilots.rules import Finding, Rule
from guidance.estimation.filters import Estimate, Height, Modes, Normal
from guidance.estimation.measurement import Measurement
from guidance.estimation.pace import Stamp
from guidance.estimation.rivals import SourceReport
from guidance.estimation.track import Accepted
from guidance.estimation.velocity_check import PlaneReport
from guidance.frames import Ned
from guidance.messages import AltitudeSaid, EvaderReport
from sitl_mock.mavlink import MessageSpec
from sitl_mock.protocols import Parameter
from sitl_mock.vector import Vector
from sitl_mock.vehicle.modes import Available, Mode, Transition

World = TypeVar("World")
TABLES = (
    Struct,
    itemgetter,
    Parameter,
    MessageSpec,
    Mode,
    Available,
    Transition,
    Rule,
    Finding,
    Version,
)
REPORTS = (AltitudeSaid, EvaderReport, Measurement, SourceReport, PlaneReport, Stamp, Ned, Vector)
ESTIMATES = (Accepted, Estimate, Modes, Normal, Height)
UNCHANGING = (*TABLES, *REPORTS, *ESTIMATES)
"""Immutable types, shared between copies: a vehicle's tables, and an evader's track, hold thousands of them."""


@contextmanager
def _copyable() -> Iterator[None]:
    """Make copies get their own locks and read-only tables, and share the immutable rows of those tables."""
    table = copyreg.dispatch_table
    before = dict(table)
    table[type(threading.Lock())] = lambda _lock: (threading.Lock, ())
    table[MappingProxyType] = lambda shown: (MappingProxyType, (dict(shown),))
    table.update(dict.fromkeys(UNCHANGING, lambda _one: "the same"))
    try:
        yield
    finally:
        table.clear()
        table.update(before)


def copied(world: World, same: Iterable[object] = ()) -> World:
    """Return a deep copy. It shares only the objects in `same`: large ones that are never modified."""
    with _copyable():
        return copy.deepcopy(world, {id(one): one for one in same})


def shared_by_functions(world: object) -> set[str]:
    """Return the functions that would use the original's objects in a copy, because closures are not copied."""
    memo: dict[int, Any] = {}
    with _copyable():
        copy.deepcopy(world, memo)
    found = set()
    seen = set()
    ahead = [world]
    while ahead:
        one = ahead.pop()
        if id(one) in seen or isinstance(one, type | ModuleType):
            continue
        seen.add(id(one))
        if isinstance(one, FunctionType):
            held = [cell.cell_contents for cell in one.__closure__ or ()]
            if any(memo.get(id(each), each) is not each for each in held):
                found.add(f"{one.__module__}.{one.__qualname__}")
            ahead += held
        else:
            ahead += gc.get_referents(one)
    return found


class Flown:
    """Worlds flown to a state, stored by their settings and that state."""

    def __init__(self) -> None:
        self._kept: dict[Hashable, Any] = {}

    def __call__(
        self,
        key: Hashable,
        fly: Callable[[], World],
        same: Callable[[World], Iterable[object]] = lambda _world: (),
    ) -> World:
        """Return a copy of the world of this key.

        Args:
            key: Settings of the world, and the state to reach.
            fly: Flies the world; called once per key.
            same: Returns objects to share between copies, for example the history.
        """
        if key not in self._kept:
            self._kept[key] = fly()
        world: World = self._kept[key]
        return copied(world, same(world))
