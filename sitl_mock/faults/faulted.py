"""A vehicle with faults: the interface of a vehicle, with the faults between it and its links.

Faults begin and end at their own times, not at the caller's next step: steps are divided at these times. A delayed
frame comes out of the first step at or after its time. Equal scripts, seeds and steps give equal bytes.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections import deque
from dataclasses import dataclass
from random import Random
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.errors import ConfigError
from sitl_mock.faults import frames
from sitl_mock.faults.effect import Direction, Effect, EffectInputs
from sitl_mock.faults.other_senders import GUIDED_OF
from sitl_mock.faults.script import KINDS, Fault, FaultScript, parse_fault
from sitl_mock.mavlink import SPEC_BY_NAME

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from sitl_mock.vehicle.mock_vehicle import MockVehicle

STATES: Final = ("ARMED", "DISARMED", "AIRBORNE", "LANDED", "READY")
MAX_COPIES: Final = 64
"""Most frames that can replace one, however many faults duplicate it."""
_SLACK_S: Final = 1e-9


@dataclass(slots=True)
class Live:
    """A fault on one vehicle: waiting (start in the future or unknown), acting, or over."""

    number: int
    fault: Fault
    effect: Effect
    event: str
    start_s: float
    struck: frozenset[int] = frozenset()
    end_s: float = math.inf
    acting: bool = False

    def strikes_link(self, direction: Direction, link: str) -> bool:
        """True if frames of this direction on this link are affected."""
        return self.fault.direction in {direction, Direction.BOTH} and self.fault.link in {"", link}

    def strikes(self, frame: bytes) -> bool:
        """True if a frame is affected; a damaged one is not if messages are named."""
        if not self.struck:
            return True
        return frames.message_id(frame) in self.struck


class Faulted:
    """A vehicle with faults.

    `inject`, `clear` and `faults` may be called from any thread; the faults change at the next step.

    Args:
        vehicle: The vehicle; its own `step` must no longer be called.
        name: Its name in the script.
        script: Its faults.

    Raises:
        ConfigError: A fault needs something that this vehicle does not have.
    """

    def __init__(
        self,
        vehicle: MockVehicle,
        name: str = "uav1",
        script: FaultScript = FaultScript(),  # noqa: B008 - an immutable value
    ) -> None:
        self.vehicle = vehicle
        self.name = name
        self.seed = script.seed
        self.transport: deque[tuple[str, float]] = deque()
        self._numbers = itertools.count(1)
        self._live: list[Live] = []
        self._requests: deque[Callable[[float], None]] = deque()
        self._late: dict[Direction, list[tuple[float, int, str, bytes]]] = {
            Direction.IN: [],
            Direction.OUT: [],
        }
        self._late_numbers = itertools.count()
        self._now_s = math.nan
        self._before: frozenset[str] = frozenset()
        self._shown: tuple[dict[str, Any], ...] = ()
        for index, fault in enumerate(script.faults):
            if fault.strikes(name):
                self._ask(fault, f"fault[{index}]")

    # Public interface

    def step(
        self, now_s: float, frames_in: Sequence[bytes] = (), link: str | None = None
    ) -> list[bytes]:
        """See `MockVehicle.step`."""
        chosen = next(iter(self.vehicle.links)) if link is None else link
        return self.step_links(now_s, {chosen: frames_in})[chosen]

    def step_links(
        self, now_s: float, frames_in: Mapping[str, Sequence[bytes]]
    ) -> dict[str, list[bytes]]:
        """See `MockVehicle.step_links`."""
        first = math.isnan(self._now_s)
        while self._requests:
            self._requests.popleft()(now_s if first else self._now_s)
        if not self._live and not self._late[Direction.IN] and not self._late[Direction.OUT]:
            self._now_s = now_s
            return self.vehicle.step_links(now_s, frames_in)
        out: dict[str, list[bytes]] = {link: [] for link in self.vehicle.links}
        if first:
            self._before = self._states()
            self._change(now_s)
        else:
            # One change after the other: each may give a waiting fault its time.
            while True:
                coming = [live.end_s if live.acting else live.start_s for live in self._live]
                next_s = min(coming, default=math.inf)
                if next_s >= now_s - _SLACK_S:
                    break
                change_s = max(next_s, self._now_s)
                self._advance(change_s, {}, out)
                self._change(change_s)
        self._advance(now_s, frames_in, out)
        self._change(now_s)
        return out

    def inject(self, values: Mapping[str, Any]) -> int:
        """Add a fault; its times count from now.

        Args:
            values: The keys of a fault in a script.

        Returns:
            Its number.

        Raises:
            ConfigError: A key is unknown, missing or wrong.
        """
        return self._ask(parse_fault({**values, "vehicle": self.name}), "fault")

    def clear(self, number: int | None = None) -> None:
        """End one fault, or all.

        Raises:
            ConfigError: There is no fault of that number.
        """
        numbers = {fault["number"] for fault in self._shown}
        if number is not None and (not isinstance(number, int) or number not in numbers):
            allowed = (
                ", ".join(str(number) for number in sorted(numbers))
                or "none, because there is no fault"
            )
            raise ConfigError(f"number = {number!r}: allowed are {allowed}")

        def drop(now_s: float) -> None:
            for live in [live for live in self._live if number in {None, live.number}]:
                self._finish(live, now_s)
                self._live.remove(live)
            self._publish()

        self._requests.append(drop)

    def faults(self) -> tuple[dict[str, Any], ...]:
        """Return every waiting or acting fault as plain values."""
        return self._shown

    # Begin and end of faults

    def _ask(self, fault: Fault, where: str) -> int:
        number = next(self._numbers)
        random = Random(f"{self.seed}/{self.name}/{number}/{fault.kind}")
        event = fault.after
        if event in {"OFFBOARD", "GUIDED"}:
            event = GUIDED_OF[self.vehicle.flavour]
        elif event and event not in {*self.vehicle.modes, *STATES}:
            allowed = ", ".join((*STATES, *self.vehicle.modes))
            raise ConfigError(f"{where}.after = {event!r}: allowed are {allowed}")
        try:
            effect = KINDS[fault.kind].make(
                EffectInputs(self.vehicle, random, fault.options, fault.messages)
            )
        except ConfigError as error:
            raise ConfigError(f"{where}.{error}") from None
        struck = frozenset(SPEC_BY_NAME[name].message_id for name in fault.messages)
        live = Live(number, fault, effect, event, math.inf, struck)

        def put(now_s: float) -> None:
            if not event:
                live.start_s = now_s + fault.at_s
            if effect.prepare is not None:
                effect.prepare(now_s)
            self._live.append(live)
            self._publish()

        self._requests.append(put)
        self._shown = (*self._shown, _as_shown(live))
        return number

    def _change(self, now_s: float) -> None:
        """Begin and end the faults that are due."""
        changed = False
        for live in list(self._live):
            if not live.acting and live.start_s <= now_s + _SLACK_S:
                live.acting = True
                live.end_s = now_s + live.fault.for_s
                if live.effect.begin is not None:
                    live.effect.begin(now_s)
                if live.effect.transport:
                    self.transport.append((live.effect.transport, live.fault.for_s))
                changed = True
            if live.acting and live.end_s <= now_s + _SLACK_S:
                self._finish(live, now_s)
                self._live.remove(live)
                changed = True
        if changed:
            self._publish()

    def _finish(self, live: Live, now_s: float) -> None:
        if live.acting and live.effect.end is not None:
            live.effect.end(now_s)
        live.acting = False

    def _publish(self) -> None:
        self._shown = tuple(_as_shown(live) for live in self._live)

    # Frames

    def _advance(
        self, now_s: float, frames_in: Mapping[str, Sequence[bytes]], out: dict[str, list[bytes]]
    ) -> None:
        """Advance the vehicle to now_s."""
        self._now_s = now_s
        inward: dict[str, list[bytes]] = {link: [] for link in self.vehicle.links}
        self._pass(Direction.IN, now_s, _flat(frames_in), inward)
        outward = self.vehicle.step_links(now_s, inward)
        self._pass(Direction.OUT, now_s, _flat(outward), out)
        for live in self._live:
            if live.acting and live.effect.advance is not None:
                self._pass(Direction.OUT, now_s, live.effect.advance(now_s), out)
        # Faults that waited for a state start when it begins.
        states = self._states()
        new = states - self._before
        self._before = states
        for live in self._live:
            if live.event in new and live.start_s == math.inf:
                live.start_s = now_s + live.fault.at_s

    def _pass(
        self,
        direction: Direction,
        now_s: float,
        came: Iterable[tuple[str, bytes]],
        through: dict[str, list[bytes]],
    ) -> None:
        """Pass frames through the faults; delayed frames wait, and due ones go first."""
        late = self._late[direction]
        while late and late[0][0] <= now_s + _SLACK_S:
            _, _, link, frame = heapq.heappop(late)
            through[link].append(frame)
        acting = [live for live in self._live if live.acting and live.effect.alter is not None]
        for link, frame in came:
            # Every acting fault alters what the one before it left.
            flows: list[tuple[float, bytes]] = [(0.0, frame)]
            for live in acting:
                alter = live.effect.alter
                if alter is None or not live.strikes_link(direction, link):
                    continue
                altered = list[tuple[float, bytes]]()
                for delay_s, passed in flows:
                    if not live.strikes(passed):
                        altered.append((delay_s, passed))
                        continue
                    altered += [
                        (delay_s + more_s, changed) for more_s, changed in alter(now_s, passed)
                    ]
                flows = altered[:MAX_COPIES]
            for delay_s, passed in flows:
                if delay_s <= 0.0:
                    through[link].append(passed)
                else:
                    heapq.heappush(late, (now_s + delay_s, next(self._late_numbers), link, passed))

    def _states(self) -> frozenset[str]:
        vehicle = self.vehicle
        grounded = vehicle.autopilot.state.on_ground
        states = {
            vehicle.mode,
            "ARMED" if vehicle.armed else "DISARMED",
            "LANDED" if grounded else "AIRBORNE",
        }
        if vehicle.autopilot.commander.ready_to_arm:
            states.add("READY")
        return frozenset(states)


def _flat(by_link: Mapping[str, Sequence[bytes]]) -> Iterator[tuple[str, bytes]]:
    for link, frames_ in by_link.items():
        for frame in frames_:
            yield link, frame


def _as_shown(live: Live) -> dict[str, Any]:
    fault = live.fault
    description: dict[str, Any] = {
        "number": live.number,
        "kind": fault.kind,
        "state": "acting" if live.acting else "waiting",
        "after": live.event,
        "at_s": fault.at_s,
        "for_s": fault.for_s if math.isfinite(fault.for_s) else None,
    }
    for name, value in fault.options.items():
        description[name] = sorted(value) if isinstance(value, frozenset) else value
    if fault.messages:
        description |= {"direction": str(fault.direction), "messages": list(fault.messages)}
    return description
