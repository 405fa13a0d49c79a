"""Mutants of guidance.game: `python tests/bench/bench_game_mutants.py [--only FILES] [--resume FILE] [--minutes M]`.

A file of a package within is named as it is imported, `--only pe,team.several`; `--tests 'test_team_*.py'` runs fewer
tests, for a quick look.

One operator, comparison, constant, condition or choice is changed at a time, in memory: a forked child imports the
changed package afresh, runs the tests that enter the changed function, the likeliest to fail first, and stops at the
first failure. A test that takes five times its processor time (and five seconds more) has noticed the change; that of
the clock on the wall does not matter. Annotations and the wording of messages are left alone: they change no result.

Printed: how many were killed, and every survivor. One that changes no result is listed in `game_mutants.toml` with the
reason, and is not run again without `--listed`; any other fails the run. What only PyTorch or JAX can notice survives
where they are not installed. A file given with `--resume` keeps what was killed, so that a later run (with those
libraries, say) judges the others alone.
"""

import argparse
import ast
import copy
import gc
import hashlib
import importlib
import json
import os
import random
import resource
import signal
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from importlib.machinery import SourceFileLoader
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings

REPORT = os.dup(1)
ROOT = Path(__file__).resolve().parents[2]
SOURCE, TESTS = ROOT / "guidance" / "game", ROOT / "tests" / "game"
LISTED = Path(__file__).with_name("game_mutants.toml")
OWN = ("guidance", "sitl_mock", "tests", "conftest", "__main__")
LIMIT = "the limit of processor time"
TIMES, SPARE_S, WALL_S = 5.0, 5.0, 3600
LIKELY = 12
"""Tests that are tried before all other files are even read."""
SWAPS = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
    ast.USub: ast.UAdd, ast.FloorDiv: ast.Mult,
}  # fmt: skip
REVERSED = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}


def mutants(tree: ast.Module) -> Iterator[tuple[str, ast.Module]]:
    """Yield a description and a changed tree for every change that can be made."""
    named = [one for one in tree.body if getattr(getattr(one, "annotation", None), "value", "") == "TypeAlias"]
    left_alone = {id(part) for one in named for part in ast.walk(one)}
    for index, node in enumerate(ast.walk(tree)):
        for number, (said, _) in enumerate(() if id(node) in left_alone else changes(node)):
            changed = copy.deepcopy(tree)
            target = next(other for place, other in enumerate(ast.walk(changed)) if place == index)
            list(changes(target))[number][1]()
            line = getattr(node, "lineno", 0)
            yield f"{line}: {said}: {ast.unparse(node)[:90]}", ast.fix_missing_locations(changed)


def changes(node: ast.AST):  # noqa: C901 - one case for each kind of node
    """Yield what can be changed at a node, and a function that does it."""
    called = getattr(node.func, "id", getattr(node.func, "attr", "")) if isinstance(node, ast.Call) else ""
    if isinstance(node, (ast.BinOp, ast.BoolOp, ast.UnaryOp, ast.AugAssign)) and type(node.op) in SWAPS:
        swapped = SWAPS[type(node.op)]
        yield f"{type(node.op).__name__} → {swapped.__name__}", lambda: setattr(node, "op", swapped())
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield "not dropped", lambda: setattr(node, "op", ast.UAdd())
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        for table in (SWAPS, REVERSED):
            if type(node.ops[0]) in table:
                other = table[type(node.ops[0])]
                yield (
                    f"{type(node.ops[0]).__name__} → {other.__name__}",
                    lambda other=other: setattr(node, "ops", [other()]),
                )
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        changed = (not node.value) if isinstance(node.value, bool) else node.value + 1
        yield f"{node.value} → {changed}", lambda: setattr(node, "value", changed)
    if isinstance(node, (ast.If, ast.IfExp)):
        yield "condition turned", lambda: setattr(node, "test", ast.UnaryOp(ast.Not(), node.test))
    if called in ("select", "select2", "_select3", "choose") and len(node.args) == 4:
        yield "choice turned", lambda: node.args.__setitem__(slice(2, 4), node.args[:1:-1])
    if called == "where" and len(node.args) == 3:
        yield "choice turned", lambda: node.args.__setitem__(slice(1, 3), node.args[:0:-1])
    if called in ("positive_part", "abs") and len(node.args) == 1:
        yield f"{called} dropped", lambda: setattr(node, "func", ast.parse("(lambda value: value)").body[0].value)


def modules() -> dict[str, Path]:
    """Return the files of the package by the names that they are imported by, without `guidance.game.`."""
    paths = {".".join(path.relative_to(SOURCE).with_suffix("").parts): path for path in SOURCE.rglob("*.py")}
    return {stem: path for stem, path in sorted(paths.items()) if path.stem != "__init__"}


def strip(tree: ast.Module) -> ast.Module:
    """Make a string of every annotation, and none of a message."""

    class Quiet(ast.NodeTransformer):
        def visit_JoinedStr(self, node):
            return ast.copy_location(ast.Constant("message"), node)

        def visit_AnnAssign(self, node):
            node.annotation = ast.Constant(ast.unparse(node.annotation))
            return self.generic_visit(node)

        def visit_FunctionDef(self, node):
            node.returns = None
            for argument in (*node.args.args, *node.args.kwonlyargs):
                argument.annotation = None
            return self.generic_visit(node)

    return ast.fix_missing_locations(Quiet().visit(tree))


class Mutant:
    """A changed file, and what it is called: file, function, change, and a number where several are alike."""

    def __init__(self, stem: str, function: str, said: str, tree: ast.Module, line: str) -> None:
        self.stem, self.function, self.said, self.tree, self.line = stem, function, said, tree, line
        self.digest = hashlib.blake2b(f"{stem}\n{ast.unparse(tree)}".encode(), digest_size=8).hexdigest()

    def reason(self, listed: dict[str, dict[str, str]]) -> str:
        """Why it changes no result, if that is known."""
        return listed.get(self.stem, {}).get(f"{self.function}: {self.said}", "")

    def __str__(self) -> str:
        return f"{self.stem}.py:{self.line}: {self.function}: {self.said}"


def drawn_from(stem: str) -> Iterator[Mutant]:
    """Yield every mutant of a file."""
    tree = strip(ast.parse((SOURCE / f"{stem.replace('.', '/')}.py").read_text()))
    functions, alike = functions_by_line(tree), Counter()
    for text, changed in mutants(tree):
        line, said = text.splitlines()[0].split(": ", 1)
        function = functions.get(int(line), "")
        alike[function, said] += 1
        number = alike[function, said]
        yield Mutant(stem, function, said if number == 1 else f"{said} ({number})", changed, line)


def functions_by_line(tree: ast.AST, prefix: str = "") -> dict[int, str]:
    """Name the outermost function or method of every line that is in one."""
    found = {}
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef):
            found |= functions_by_line(node, f"{node.name}.")
        elif isinstance(node, ast.FunctionDef):
            first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            found |= dict.fromkeys(range(first, node.end_lineno + 1), prefix + node.name)
    return found


class Judge:
    """A pytest plugin: the given tests in the given order, each within its own limit of processor time."""

    def __init__(self, limits: dict[str, float], tell: Callable[[str], None]) -> None:
        self.limits, self.order, self.tell = limits, {name: place for place, name in enumerate(limits)}, tell

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items) -> None:
        """Choose the tests and put them in order."""
        items[:] = sorted((one for one in items if one.nodeid in self.order), key=lambda one: self.order[one.nodeid])

    def pytest_runtest_logstart(self, nodeid, location) -> None:
        """Set the limit of a test."""
        limit = int(time.process_time() + self.limits[nodeid]) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.RLIM_INFINITY))

    def pytest_runtest_logreport(self, report) -> None:
        """Name the test that failed."""
        if report.failed:
            self.tell(report.nodeid)


class Survey:
    """A pytest plugin: what each test costs, and which functions of the package it enters."""

    def __init__(self) -> None:
        self.costs_s: dict[str, float] = {}
        self.entered: dict[str, list[str]] = {}
        self.names = {
            str(path): (stem, functions_by_line(ast.parse(path.read_text()))) for stem, path in modules().items()
        }

    def pytest_runtest_logstart(self, nodeid, location) -> None:
        """Start to count."""
        self.calls: set[tuple[str, int]] = set()
        self.started = time.process_time()
        sys.settrace(lambda frame, *_: self.calls.add((frame.f_code.co_filename, frame.f_code.co_firstlineno)))

    def pytest_runtest_logfinish(self, nodeid, location) -> None:
        """Keep the count."""
        sys.settrace(None)
        self.costs_s[nodeid] = time.process_time() - self.started
        known = [(*self.names[file], line) for file, line in self.calls if file in self.names]
        self.entered[nodeid] = sorted({f"{stem}.{lines.get(line, '')}" for stem, lines, line in known})


def in_child(work: Callable[[Callable[[str], None]], int]) -> tuple[int, str]:
    """Do something in a forked child; return how it ended, as `os.waitpid` has it, and what it told."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        code = 70
        try:
            silence = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silence, 1)
            os.dup2(silence, 2)
            signal.alarm(WALL_S)
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            code = work(lambda text: os.write(write, text.encode()))
        finally:
            os._exit(code)
    os.close(write)
    with os.fdopen(read) as told:
        text = told.read()
    return os.waitpid(child, 0)[1], text


def run_tests(plugin: object, files: list[str]) -> int:
    """Run test files up to the first failure."""
    options = ["-q", "-x", "-m", "not slow", "-p", "no:cacheprovider", "--assert=plain", f"--rootdir={ROOT}"]
    return int(pytest.main([*options, *files], plugins=[plugin]))


def survey(tests: str) -> tuple[dict[str, float], dict[str, list[str]]]:
    """Run all tests without a change, and import here what they import, so that no child has to."""

    def work(tell) -> int:
        plugin = Survey()
        files = {str(path) for pattern in tests.split(",") for path in TESTS.glob(pattern)}
        code = run_tests(plugin, sorted(files))
        modules = [name for name in sys.modules if name.split(".")[0] not in OWN and "test_" not in name]
        tell(json.dumps([plugin.costs_s, plugin.entered, modules]))
        return code

    status, told = in_child(work)
    if status:
        raise SystemExit(f"the tests fail without a change: {told[-500:]}")
    costs_s, entered, modules = json.loads(told)
    for name in modules:
        try:
            importlib.import_module(name)
        except ImportError:
            continue
    gc.freeze()
    return costs_s, entered


def judge(mutant: Mutant, limits: dict[str, float]) -> str:
    """Return who noticed a mutant, or nothing."""
    if not limits:
        return ""

    def work(tell) -> int:
        original = SourceFileLoader.get_code

        def get_code(self, name):
            if name == f"guidance.game.{mutant.stem}":
                return compile(mutant.tree, self.path, "exec")
            return original(self, name)

        SourceFileLoader.get_code = get_code
        return run_tests(Judge(limits, tell), sorted({name.split("::")[0] for name in limits}))

    status, told = in_child(work)
    if os.WIFSIGNALED(status):
        ended = signal.Signals(os.WTERMSIG(status))
        return {signal.SIGXCPU: LIMIT, signal.SIGALRM: ""}.get(ended, ended.name)
    return told.split("\n")[0] or ("the import" if status else "")


def say(line: str) -> None:
    """Print past pytest's capture."""
    os.write(REPORT, f"{line}\n".encode())


def judge_all(drawn: list[Mutant], kept: Path, ends: float, tests: str) -> dict[str, str]:
    """Return who noticed each mutant, by digest; what was killed before is not judged again."""
    verdicts = dict(map(json.loads, kept.read_text().splitlines())) if kept.exists() else {}
    waiting = [one for one in drawn if one.digest not in verdicts]
    if not waiting or time.monotonic() > ends:
        return verdicts
    costs_s, entered = survey(tests)
    say(f"{len(costs_s)} tests, {sum(costs_s.values()):.0f} s of processor time; {len(waiting)} mutants to judge")
    kills = Counter(verdicts.values())
    with kept.open("a") as keep:
        for number, mutant in enumerate(waiting, 1):
            if time.monotonic() > ends:
                break
            place = f"{mutant.stem}.{mutant.function}"
            tests = [name for name in costs_s if not mutant.function or place in entered[name]]
            tests.sort(key=lambda name: costs_s[name] / (1 + kills[name]))
            limits = [(name, SPARE_S + TIMES * costs_s[name]) for name in tests]
            killer = judge(mutant, dict(limits[:LIKELY])) or judge(mutant, dict(limits[LIKELY:]))
            verdicts[mutant.digest] = killer
            kills[killer] += 1
            if killer:
                keep.write(json.dumps([mutant.digest, killer]) + "\n")
                keep.flush()
            else:
                say(f"survived: {mutant}")
            if number % 100 == 0:
                say(f"judged so far: {number}")
    return verdicts


def report(drawn: list[Mutant], verdicts: dict[str, str], listed: dict[str, dict[str, str]]) -> int:
    """Print the numbers, and return how many survivors change a result."""
    harmless = sorted((one for one in drawn if one.reason(listed)), key=lambda one: (one.stem, int(one.line)))
    for one in harmless:
        noticed = verdicts.get(one.digest)
        say(f"{one}\n    {f'LISTED, YET NOTICED BY {noticed}' if noticed else one.reason(listed)}")
    judged = [one for one in drawn if one.digest in verdicts and not one.reason(listed)]
    killed = [one for one in judged if verdicts[one.digest]]
    slow = sum(verdicts[one.digest] == LIMIT for one in killed)
    left = len(drawn) - len(harmless) - len(judged)
    say(
        f"{len(drawn)} mutants: {len(killed)} killed ({slow} of them by the limit of processor time), {len(harmless)} "
        f"change no result (above), {len(judged) - len(killed)} survived, {left} not judged"
    )
    return len(judged) - len(killed)


def main() -> int:
    """Judge mutants until all are, or the time is up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="comma-separated modules")
    parser.add_argument("--tests", default="test_*.py", help="comma-separated patterns of the test files to run")
    parser.add_argument("--minutes", type=float, default=600.0)
    parser.add_argument("--listed", action="store_true", help="run what is listed, too")
    parser.add_argument("--resume", type=Path, default=Path(os.devnull), help="a file that keeps what was killed")
    given = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    os.chdir(ROOT)
    calm = {"derandomize": True, "database": None, "deadline": None, "suppress_health_check": list(HealthCheck)}
    settings.register_profile("mutants", phases=[Phase.explicit, Phase.generate], max_examples=20, **calm)
    settings.load_profile("mutants")
    os.environ["HYPOTHESIS_PROFILE"] = "mutants"  # which the tests load again
    stems = list(modules())
    chosen = given.only.split(",") if given.only else stems
    drawn = [mutant for stem in stems if stem in chosen for mutant in drawn_from(stem)]
    random.Random(0).shuffle(drawn)
    listed = tomllib.loads(LISTED.read_text())
    run = [one for one in drawn if given.listed or not one.reason(listed)]
    return min(
        report(drawn, judge_all(run, given.resume, time.monotonic() + 60.0 * given.minutes, given.tests), listed), 1
    )


if __name__ == "__main__":
    sys.exit(main())
