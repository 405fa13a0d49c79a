"""Mutants of the flight machine and of control: `python tests/bench/bench_flight_mutants.py [--only FILES]`.

One change at a time, in memory, in a forked child that stops at the first test that fails: operators, comparisons,
constants and conditions as in `mutation.py`, and besides every statement with an effect dropped, every entry
of a table dropped, every two neighbours of an ordered table exchanged, every line of the transition table missing or
leading elsewhere, every mode allowed or forbidden. Printed: how many were killed, and every survivor; those that
change nothing are listed in `flight_mutants.toml` with the reason, and are printed with it: by the change, or, where
that says little (a constant), by the function that holds it and the change. `--minutes` bounds a run,
`--resume FILE` keeps the judged ones of an earlier run. The limit on one mutant is of processor time.
"""

import argparse
import ast
import copy
import functools
import inspect
import json
import os
import random
import resource
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import Phase, settings
from mutation import ROOT, functions_by_line, mutants

REPORT = os.dup(1)
LIMIT_S = 150
LISTED = Path(__file__).with_name("flight_mutants.toml")
FLIGHTS = (
    "pitfalls/test_loss_and_takeover",
    "pitfalls/test_offboard_entry",
    "pitfalls/test_parameters_and_owners",
    "pitfalls/test_evaders_and_time",
    "session/test_daemon",
    "pitfalls/test_frames_and_limits",
)
CLOSED_LOOP = ("control/test_setpoint_limiter_any_input", "control/test_setpoint_limiter_in_flight")
FLIGHT = {
    "flight/test_detection": "flight/detection flight/readiness",
    "flight/test_heard_echo": "flight/heard",
    "flight/test_playing": "flight/playing",
    "flight/test_settings": "flight/settings",
    "flight/test_playing_information": "flight/playing",
    "flight/test_playing_memory": "flight/playing",
    "flight/test_machine_operator": "flight/machine",
    "flight/test_machine_faults": "flight/machine flight/requests",
    "flight/test_machine": "flight/machine flight/requests",
    "flight/test_tracking_frames": "flight/tracking",
    "flight/test_table": "flight/table",
    "flight/test_tracking": "flight/tracking",
    "flight/test_tracking_fence": "flight/tracking",
}
CONTROL = {
    "control/test_velocity_constraints_together": "control/fence control/velocity_constraints",
    "control/test_hold": "control/hold",
    "control/test_envelope": "control/envelope",
    "control/test_setpoint_limiter": "control/setpoint_limiter control/shaping",
    "control/test_velocity_constraints": "control/velocity_constraints",
    "control/test_follow_approach": "control/follow",
    "control/test_follow_catch_up": "control/follow",
    "control/test_servo": "control/servo",
    "control/test_follow": "control/follow",
    "control/test_follow_drift": "control/follow",
    "control/test_fence": "control/fence",
    "control/test_braking": "control/braking",
}
NEAREST = {**FLIGHT, **CONTROL}
PACKAGES = {"flight": tuple(FLIGHT), "control": tuple(CONTROL)}
FIRST = {stem: tests for tests, stems in NEAREST.items() for stem in stems.split()}
WHOLE = {"test_each_event_leads_where_it_should_and_from_nowhere_else", "test_the_modes_of_our_own_doing_by_state"}
FOLDERS = ("control", "flight", "pitfalls", "session")
Planted = Callable[[], None]


def _named(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}"


def drawn_from(package: str, stem: str) -> Iterator[tuple[str, Planted]]:
    """Yield a description and a function that plants it, for every change to one file."""
    name = f"guidance.{package}.{stem}"
    source = (ROOT / "guidance" / package / f"{stem}.py").read_text()
    tree = ast.fix_missing_locations(without_annotations(without_enumerations(ast.parse(source))))
    yield "", lambda: plant(name, tree)
    seen: Counter[str] = Counter()
    for said, changed in (*mutants(tree), *dropped(tree), *exchanged(tree)):
        seen[said] += 1
        again = f" ({seen[said]})" if seen[said] > 1 else ""
        yield said + again, lambda changed=changed: plant(name, changed)
    if stem == "table":
        yield from rewired()


def without_enumerations(tree: ast.Module) -> ast.Module:
    """Leave enumerations as they are: their members are compared by identity everywhere."""
    tree.body = [
        node
        for node in tree.body
        if not (isinstance(node, ast.ClassDef) and any(getattr(base, "id", "") == "StrEnum" for base in node.bases))
    ]
    return tree


def without_annotations(tree: ast.Module) -> ast.Module:
    """Leave out annotations, which change nothing, and zip's `strict`, which only guards against other mistakes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            for keyword in (keyword for call in node.decorator_list for keyword in getattr(call, "keywords", ())):
                keyword.value = ast.Name("__debug__", ast.Load())  # True, and no constant to be changed
        if isinstance(node, ast.FunctionDef):
            node.returns = None
            for argument in (*node.args.args, *node.args.kwonlyargs):
                argument.annotation = None
        elif isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant("annotation")
        elif isinstance(node, ast.Call):
            node.keywords = [keyword for keyword in node.keywords if keyword.arg != "strict"]
    return tree


def dropped(tree: ast.Module) -> Iterator[tuple[str, ast.Module]]:
    """Every statement within a function that has an effect, and every entry of a table, left out."""
    for index, node in enumerate(ast.walk(tree)):
        for number in range(len(droppable(node))):
            changed = copy.deepcopy(tree)
            twin = next(other for place, other in enumerate(ast.walk(changed)) if place == index)
            body, place = droppable(twin)[number]
            gone = body[place]
            body[place] = ast.copy_location(ast.Pass(), gone)
            yield f"{gone.lineno}: dropped: {ast.unparse(gone)[:90]}", ast.fix_missing_locations(changed)


def droppable(node: ast.AST) -> list[tuple[list[ast.stmt], int]]:
    """Places of statements that call, write or leave."""
    found = []
    if isinstance(node, (ast.FunctionDef, ast.If, ast.For, ast.While, ast.With, ast.Try)):
        for body in (node.body, getattr(node, "orelse", [])):
            for place, one in enumerate(body):
                call = isinstance(one, ast.Expr) and not isinstance(one.value, ast.Constant)
                write = isinstance(one, ast.AugAssign) or (
                    isinstance(one, ast.Assign) and any(not isinstance(to, ast.Name) for to in one.targets)
                )
                leave = isinstance(one, (ast.Return, ast.Continue, ast.Raise)) and isinstance(node, (ast.If, ast.For))
                if call or write or leave:
                    found.append((body, place))
    return found


def exchanged(tree: ast.Module) -> Iterator[tuple[str, ast.Module]]:
    """Every two neighbours of a table of functions exchanged: the order says which event is the more severe."""
    for index, node in enumerate(ast.walk(tree)):
        if not (isinstance(node, ast.Dict) and any(isinstance(value, ast.Lambda) for value in node.values)):
            continue
        for first in range(len(node.keys) - 1):
            changed = copy.deepcopy(tree)
            twin = next(other for place, other in enumerate(ast.walk(changed)) if place == index)
            for row in (twin.keys, twin.values):
                row[first : first + 2] = row[first + 1], row[first]
            pair = f"{ast.unparse(node.keys[first])} and {ast.unparse(node.keys[first + 1])}"
            yield f"{node.keys[first].lineno}: exchanged: {pair}", ast.fix_missing_locations(changed)


def rewired() -> Iterator[tuple[str, Planted]]:
    """Every line of the transition table missing or leading elsewhere; every mode taken from or given to a state."""
    from guidance.autopilots import Mode
    from guidance.flight.table import OUR_MODES, TRANSITIONS, State

    for (state, event), after in TRANSITIONS.items():
        others = [other for other in State if other is not after]
        other = others[len(f"{state}{event}") % len(others)]
        pair = f"({state}, {event})"
        yield f"0: missing: {pair}", lambda state=state, event=event: TRANSITIONS.pop((state, event))
        yield (
            f"0: leads to {other}: {pair}",
            lambda state=state, event=event, other=other: TRANSITIONS.__setitem__((state, event), other),
        )
    for state, modes in OUR_MODES.items():
        for mode in Mode:
            said = "forbidden" if mode in modes else "allowed"
            changed = modes ^ {mode}
            yield (
                f"0: {said}: {mode} while {state}",
                lambda state=state, changed=changed: OUR_MODES.__setitem__(state, changed),
            )


def plant(name: str, tree: ast.Module) -> None:
    """Run a changed source, and put its code into the functions and its values into the names that everyone knows."""
    module = vars(sys.modules[name])
    fresh = dict(module)
    exec(compile(tree, name, "exec"), fresh)
    for key, old in list(module.items()):
        new = fresh[key]
        if new is old or key.startswith("__"):
            continue
        if isinstance(old, type):
            for one, method in vars(old).items():
                transplant(method, vars(new).get(one))
        elif inspect.isfunction(old):
            transplant(old, new)
        else:
            for other in [other for known, other in sys.modules.items() if known.startswith("guidance")]:
                if vars(other).get(key) is old:
                    setattr(other, key, new)


def transplant(old: object, new: object) -> None:
    """Give a function, or what wraps one in a class, the code and defaults of its changed twin."""
    if isinstance(old, property):
        old, new = old.fget, new.fget
    old, new = getattr(old, "__func__", old), getattr(new, "__func__", new)
    if inspect.isfunction(old) and inspect.isfunction(new):
        old.__code__, old.__defaults__, old.__kwdefaults__ = new.__code__, new.__defaults__, new.__kwdefaults__


class Forks:
    """A pytest plugin that collects the tests once, and runs them in a forked child for every mutant."""

    def __init__(self, drawn: list[tuple[str, str, str, Planted]], ends: float, judged: dict[str, bool], kept) -> None:
        self.drawn, self.ends, self.judged, self.kept = drawn, ends, judged, kept
        self.killers: dict[tuple[str, str], Counter[str]] = {}
        self.took_s: dict[str, float] = {}
        self.listed = tomllib.loads(LISTED.read_text()) if LISTED.exists() else {}

    def pytest_runtestloop(self, session) -> bool:
        """Judge mutants until the time is up, and print the count."""
        for package in sorted({package for package, *_ in self.drawn}):
            unchanged = [planted for of, _, said, planted in self.drawn if of == package and not said]
            if not self.survives(
                session, package, "", lambda unchanged=unchanged: [planted() for planted in unchanged]
            ):
                raise SystemExit(f"{package}: the tests fail without a change")
        mutated = {f"{package}/{stem}.py:{said}": entry for entry in self.drawn for package, stem, said, _ in [entry]}
        mutated = {key: entry for key, entry in mutated.items() if entry[2]}
        for key, (package, stem, _, planted) in mutated.items():
            if key not in self.judged and time.monotonic() < self.ends:
                self.judge(key, survived=self.survives(session, package, stem, planted), reason=self.reason(key))
        judged = [key for key in mutated if key in self.judged]
        survivors = sorted(key for key in judged if self.judged[key])
        killed = len(judged) - len(survivors)
        share = 100.0 * killed / max(len(judged), 1)
        say("\nsurvivors")
        for key in survivors:
            say(f"  {key}{self.reason(key)}")
        say(f"{len(judged)} of {len(mutated)} judged, {killed} killed ({share:.1f} %), {len(survivors)} survived")
        return True

    def judge(self, key: str, *, survived: bool, reason: str) -> None:
        """Note and print what became of a mutant."""
        self.judged[key] = survived
        if self.kept is not None:
            self.kept.write(json.dumps([key, survived]) + "\n")
            self.kept.flush()
        if survived:
            say(f"survived: {key}{reason}")
        if len(self.judged) % 100 == 0:
            say(f"judged so far: {len(self.judged)}")

    def reason(self, key: str) -> str:
        """Why a survivor changes nothing, where that is known: by what holds it and what it says, or by that alone."""
        file, _, said = key.partition(".py:")
        line, _, change = said.partition(": ")
        listed = self.listed.get(file, {})
        reason = listed.get(f"{holders(file).get(int(line), 'module')}: {change}", listed.get(change))
        return f"\n      harmless: {reason}" if reason else "\n      NOT LISTED"

    def survives(self, session, package: str, stem: str, planted: Planted) -> bool:
        """Run the tests against a mutant in a child; a child that hangs or dies has been noticed."""
        files, mine = PACKAGES[package], self.killers.setdefault((package, stem), Counter())
        items = [item for item in session.items if _named(item.path) in files]
        first = FIRST.get(f"{package}/{stem}", "")
        items.sort(
            key=lambda item: (
                -mine[item.nodeid],
                _named(item.path) != first,
                item.originalname not in WHOLE,
                self.took_s.get(item.nodeid, 0.0),
            )
        )
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            code = 1
            try:
                os.close(reading)
                resource.setrlimit(resource.RLIMIT_CPU, (LIMIT_S, LIMIT_S))
                planted()
                code = int(any(self.fails(session, item, writing) for item in items))
            finally:
                os._exit(code)
        os.close(writing)
        with os.fdopen(reading) as told:
            said = [json.loads(line) for line in told]
        survived = os.waitpid(child, 0)[1] == 0
        if not survived and said:
            mine[said[-1][0]] += 1
        elif stem == "":
            self.took_s.update(said)
        return survived

    @staticmethod
    def fails(session, item, writing: int) -> bool:
        """Run one test, tell the parent how long it took, and say whether it failed."""
        began_s = time.process_time()
        session.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
        failed = bool(session.testsfailed)
        os.write(writing, f"{json.dumps([item.nodeid, time.process_time() - began_s])}\n".encode())
        return failed


@functools.cache
def holders(file: str) -> dict[int, str]:
    """Name the function, method or class that holds each line of a file: line numbers themselves do not last."""
    tree = ast.parse((ROOT / "guidance" / f"{file}.py").read_text())
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    lines = {line: node.name for node in classes for line in range(node.lineno, (node.end_lineno or 0) + 1)}
    return lines | functions_by_line(tree)


def say(line: str) -> None:
    """Print past pytest's capture."""
    os.write(REPORT, f"{line}\n".encode())


def main() -> None:
    """Draw mutants at random until all are judged or the time is up."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="comma-separated, as control/fence or flight")
    parser.add_argument("--lines", default="", help="comma-separated line numbers, to judge some again")
    parser.add_argument("--resume", type=Path, help="a file that keeps what was judged")
    parser.add_argument("--flights", action="store_true", help="let flights and wide searches judge as well")
    given = parser.parse_args()
    if given.flights:
        PACKAGES.update(
            flight=(*PACKAGES["flight"], *FLIGHTS),
            control=(*PACKAGES["control"], *CLOSED_LOOP),
        )
    sys.path.insert(0, str(ROOT))
    os.chdir(ROOT)
    drawn = []
    for package in PACKAGES:
        for path in sorted((ROOT / "guidance" / package).glob("*.py")):
            only = given.only.split(",") if given.only else [package]
            if path.stem in ("__init__",) or not {package, f"{package}/{path.stem}"} & set(only):
                continue
            drawn += [(package, path.stem, said, planted) for said, planted in drawn_from(package, path.stem)]
    if given.lines:
        wanted = given.lines.split(",")
        drawn = [entry for entry in drawn if not entry[2] or entry[2].split(":")[0] in wanted]
    random.Random(given.seed).shuffle(drawn)
    judged: dict[str, bool] = {}
    if given.resume and given.resume.exists():
        judged = dict(map(json.loads, given.resume.read_text().splitlines()))
    settings.register_profile(
        "mutants",
        phases=[Phase.explicit, Phase.generate],
        database=None,
        derandomize=True,
        max_examples=20,
        deadline=None,
    )
    settings.load_profile("mutants")
    os.environ["HYPOTHESIS_PROFILE"] = "mutants"  # which the tests load again
    names = {name for package, *_ in drawn for name in PACKAGES[package]}
    files = sorted(
        str(path) for folder in FOLDERS for path in (ROOT / "tests" / folder).glob("*.py") if _named(path) in names
    )
    options = ["-qq", "-p", "no:cacheprovider", "-p", "no:terminalreporter", "--assert=plain", f"--rootdir={ROOT}"]
    kept = given.resume.open("a") if given.resume else None
    pytest.main([*options, *files], plugins=[Forks(drawn, time.monotonic() + 60.0 * given.minutes, judged, kept)])


if __name__ == "__main__":
    main()
