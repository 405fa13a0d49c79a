"""The walk of one LOCAL_POSITION_NED to its setpoint: `python -m tests.bench.bench_walk [--list] [--autopilot NAME]`.

With `--named` it counts the three walks of calls in docs/architecture.md: hops, files and lines of the functions named.

A daemon on a UDP socket flies a mock in virtual time until the game runs. Then one cycle receives a single
LOCAL_POSITION_NED, and all calls of functions in `guidance` are counted, from `Daemon.step` to the setpoint's datagram.
It prints the numbers of calls, functions, lines of code, files, and changes of file between calls: of all calls,
without the game's closed form (`guidance.game`), and without all methods of vectors. `--list` prints the
calls in order, indented by depth. Comprehensions do not count, because newer Pythons inline them; resumed generators do
not count either. Nowhere counted is the arithmetic of `Ned` and `Enu`, because a reader does not follow `a + b` into
another file; their named methods, such as `dot` and `length`, count as all calls do.
"""

import argparse
import ast
import contextlib
import itertools
import re
import socket
import sys
import time
from collections import Counter
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import guidance
from guidance.clock import VirtualClock
from guidance.flight import State
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.links.wires.udp import AddressPins, UdpWire
from guidance.session.fly.daemon import Daemon, Equipment
from guidance.session.fly.loop import PERIOD_S
from guidance.session.plan import plan_of
from sitl_mock.vehicle.mock_vehicle import MockVehicle
from tests.harness.chase import ORDERS, Runner, hover_chase

PAGE = Path(__file__).parents[2] / "docs" / "architecture.md"
ROOT = str(Path(guidance.__file__).parent)
ENGAGED_S = 4.0
LOCAL_POSITION_NED = 32
VECTORS = ("_Vector.", "Ned.", "Enu.")
"""Classes of `guidance.frames` whose methods are sums, products and lengths."""
INLINED = {"<listcomp>", "<setcomp>", "<dictcomp>", "<genexpr>"}
FRAMES = str(Path(guidance.__file__).with_name("frames.py"))
ARITHMETIC = {"__add__", "__sub__", "__mul__", "__truediv__"}


class Call(NamedTuple):
    """One call: depth, file, function and its number of lines."""

    depth: int
    file: str
    function: str
    lines: int


class Walk:
    """Records all calls within `guidance` while it is the profile function, until `arrived`."""

    def __init__(self) -> None:
        self.calls: list[Call] = []
        self.arrived = False
        self._depth = 0
        self._begun: set[FrameType] = set()

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if self.arrived or not code.co_filename.startswith(ROOT) or code.co_name in INLINED:
            return
        if code.co_filename == FRAMES and code.co_name in ARITHMETIC:
            return
        if event == "call" and frame in self._begun:
            self._depth += 1
        elif event == "call":
            self._begun.add(frame)
            lines = len({line for *_, line in code.co_lines() if line is not None})
            self.calls.append(
                Call(self._depth, code.co_filename[len(ROOT) + 1 :], code.co_qualname, lines)
            )
            self._depth += 1
        elif event == "return":
            self._depth -= 1


def summary(calls: list[Call]) -> str:
    """Return the size of a walk in words."""
    changes = sum(call.file != next_call.file for call, next_call in itertools.pairwise(calls))
    functions = {call[1:] for call in calls}
    files = {call.file for call in calls}
    lines = sum(lines for *_, lines in functions)
    totals = f"{len(calls)} calls, {len(functions)} functions, {lines} lines"
    return f"{totals}, {len(files)} files, {changes} changes of file"


class Named(NamedTuple):
    """A walk that a page names: its title and the file and function of each hop."""

    title: str
    hops: tuple[tuple[str, str], ...]


def named_walks(page: str) -> list[Named]:
    """Return the walks that a page names, as numbered lists of `file` `function` behind a title in bold."""
    titled = re.findall(r"^\*\*(.+?)\.\*\*(.*?)(?=^\*\*|^## |\Z)", page, re.DOTALL | re.MULTILINE)
    found = (
        Named(title, tuple(re.findall(r"^\d+\. `([\w/]+\.py)` `([\w.]+)`", text, re.MULTILINE)))
        for title, text in titled
    )
    return [walk for walk in found if walk.hops]


def lines_of(file: str, function: str, root: str = ROOT) -> int:
    """Return the number of lines of a function with its docstring; 0 if it does not exist."""
    body: list[ast.stmt] = ast.parse((Path(root) / file).read_text(encoding="utf-8")).body
    for name in function.split("."):
        kinds = ast.FunctionDef | ast.ClassDef
        node = None
        for statement in body:
            if isinstance(statement, kinds) and statement.name == name:
                node = statement
                break
        if node is None:
            return 0
        body = node.body
    return (node.end_lineno or node.lineno) - node.lineno + 1


def describe(walk: Named, root: str = ROOT) -> str:
    """Return the size of a named walk in words."""
    files = {file for file, _ in walk.hops}
    lines = sum(lines_of(*hop, root) for hop in dict.fromkeys(walk.hops))
    return f"{walk.title}: {len(walk.hops)} hops, {len(files)} files, {lines} lines"


class WatchedWire(UdpWire):
    """A socket that ends a walk when it sends. Its reader thread leaves all reading to the loop."""

    walk: Walk | None = None

    def _watch(self) -> None:
        time.sleep(0.01)

    def send(self, frame: bytes) -> None:
        """See `Wire`."""
        super().send(frame)
        if self.walk is not None:
            self.walk.arrived = True


def walk(autopilot: str) -> Walk:
    """Fly until `ENGAGED_S` after engagement, then record one cycle."""
    scenario = hover_chase(autopilot, seed=1)
    clock = VirtualClock()
    walked = Walk()
    plan = plan_of(scenario=scenario)
    vehicle = MockVehicle(autopilot, seed=1, ready_after_s=1.0)
    wire = WatchedWire(clock.now_s, "127.0.0.1", 0, AddressPins())
    theirs = socket.socket(type=socket.SOCK_DGRAM)
    with contextlib.closing(wire), theirs:
        theirs.connect(("127.0.0.1", wire.port))
        theirs.setblocking(False)
        link = PymavlinkLink(wire, clock.now_s, system_id=1)
        runner = Runner(scenario, plan.flight)
        daemon = Daemon("walk", plan, link, {"evader": runner}, Equipment())
        engaged_s = float("inf")
        while not walked.arrived:
            now_s = clock.now_s()
            state = daemon.flight.state
            frames = vehicle.step(now_s, _datagrams(theirs))
            place = vehicle.truth.position_ned_m
            runner.advance(now_s, place[:2], running=now_s > engaged_s)
            if state is State.ENGAGED:
                engaged_s = min(engaged_s, now_s)
            positions = [
                frame
                for frame in frames
                if int.from_bytes(frame[7:10], "little") == LOCAL_POSITION_NED
            ]
            counted = now_s > engaged_s + ENGAGED_S and len(positions) == 1
            for frame in positions if counted else frames:
                theirs.send(frame)
            for order in ORDERS.get(state, ()):
                daemon.mailbox.ask(str(order))
            if counted:
                runner.receive()
                wire.walk = walked
                sys.setprofile(walked)
            try:
                daemon.step(now_s)
            finally:
                sys.setprofile(None)
            clock.sleep_until(now_s + PERIOD_S)
    return walked


def _datagrams(theirs: socket.socket) -> list[bytes]:
    """Return every datagram that has arrived."""
    found = []
    with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
        while True:
            found.append(theirs.recv(65536))
    return found


def main() -> None:
    """Print the walk."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--autopilot", choices=("px4", "arducopter"), default="px4")
    parser.add_argument(
        "--list", action="store_true", help="print every call, indented by depth, and calls by file"
    )
    parser.add_argument(
        "--named", action="store_true", help="count the walks that docs/architecture.md names"
    )
    arguments = parser.parse_args()
    if arguments.named:
        for named in named_walks(PAGE.read_text(encoding="utf-8")):
            print(describe(named))
        return
    walked = walk(arguments.autopilot)
    if arguments.list:
        for call in walked.calls:
            print(f"{'  ' * call.depth}{call.function}  ({call.file})")
        for file, calls in Counter(call.file for call in walked.calls).most_common():
            print(f"{calls:4d}  {file}")
    print(summary(walked.calls))
    beside = [call for call in walked.calls if not call.file.startswith("game/")]
    print(f"beside the game's closed form: {summary(beside)}")
    plain = [call for call in walked.calls if not call.function.startswith(VECTORS)]
    print(f"beside all methods of vectors: {summary(plain)}")


if __name__ == "__main__":
    main()
