"""Mutants of guidance.game: `python tests/bench/bench_game_mutants.py [--minutes M] [--seed S] [--only FILES]`.

One operator, comparison, constant or condition is changed at a time, in memory, in a forked child that runs the tests
of that file and stops at the first failure; no file is touched. Printed: how many were killed, and every survivor with
its place and change, for a person to judge whether it changes a result.
"""

import argparse
import ast
import copy
import inspect
import os
import random
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import Phase, settings

REPORT = os.dup(1)
ROOT = Path(__file__).resolve().parents[2]
SOURCE, TESTS = ROOT / "guidance" / "game", ROOT / "tests" / "game"
LIMIT_S = 60
CORE = (
    "test_reference",
    "test_solve_closed_forms",
    "test_degenerate_states",
    "test_bad_input",
    "test_brute_force",
    "test_batch_bits",
)
COVERING = {
    "apollonius": ("test_reference", "test_solve_closed_forms", "test_bad_input"),
    "batch": (
        "test_reference",
        "test_batch_bits",
    ),
    "gradient": (
        "test_reference",
        "test_hji",
    ),
    "hji": (
        "test_reference",
        "test_hji",
    ),
    "policies": ("test_reference", "test_policies", "test_bad_input", "test_degenerate_states", "test_batch_bits"),
    "rollout": ("test_reference", "test_rollout", "test_bad_input"),
    "stepping": ("test_reference", "test_rollout", "test_bad_input"),
    "terminal": (
        "test_reference",
        "test_rollout",
    ),
    "search": ("test_reference", "test_brute_force", "test_degenerate_states", "test_symmetry", "test_batch_bits"),
    "reach": (
        "test_reference",
        "test_solve_closed_forms",
        "test_degenerate_states",
        "test_policies",
        "test_brute_force",
        "test_rollout",
    ),
}
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
    for index, node in enumerate(ast.walk(tree)):
        for number, (said, _) in enumerate(changes(node)):
            changed = copy.deepcopy(tree)
            target = next(other for place, other in enumerate(ast.walk(changed)) if place == index)
            list(changes(target))[number][1]()
            line = getattr(node, "lineno", 0)
            yield f"{line}: {said}: {ast.unparse(node)[:90]}", ast.fix_missing_locations(changed)


def changes(node: ast.AST):  # noqa: C901 - one case for each kind of node
    """Yield what can be changed at a node, and a function that does it."""
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
    if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("select", "select2") and len(node.args) == 4:
        yield "choice turned", lambda: node.args.__setitem__(slice(2, 4), node.args[:1:-1])
    if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("positive_part", "abs") and len(node.args) == 1:
        yield f"{node.func.id} dropped", lambda: setattr(node, "func", ast.Name("float_like", ast.Load()))


class Forks:
    """A pytest plugin that collects the tests once, and runs them in a forked child for every mutant."""

    def __init__(self, drawn: list[tuple[str, str, ast.Module]], ends: float) -> None:
        self.drawn, self.ends = drawn, ends

    def pytest_runtestloop(self, session) -> bool:
        """Judge mutants until the time is up, and print the count."""
        killed, survivors = 0, 0
        for stem in sorted({stem for stem, _, _ in self.drawn}):
            if not self.survives(session, stem, ast.parse((SOURCE / f"{stem}.py").read_text()), first=True):
                say(f"{stem}.py: its tests fail without a change; left out")
                self.drawn = [entry for entry in self.drawn if entry[0] != stem]
        for stem, said, tree in self.drawn:
            if time.monotonic() > self.ends:
                break
            if self.survives(session, stem, tree):
                survivors += 1
                say(f"survived: {stem}.py:{said}")
            else:
                killed += 1
            if (killed + survivors) % 50 == 0:
                say(f"judged so far: {killed + survivors}, killed {killed}")
        judged = killed + survivors
        share = 100.0 * killed / max(judged, 1)
        say(f"{judged} of {len(self.drawn)} mutants judged, {killed} killed ({share:.1f} %), {survivors} survived")
        return True

    def survives(self, session, stem: str, tree: ast.Module, *, first: bool = False) -> bool:
        """Run the tests of a file against a mutant in a child; a child that hangs or dies has been noticed."""
        child = os.fork()
        if child == 0:
            signal.alarm(LIMIT_S)
            code = 1
            try:
                plant(f"guidance.game.{stem}", tree)
                files = COVERING.get(stem, CORE)[: 1 if first else None]
                items = sorted(
                    (item for item in session.items if item.path.stem in files),
                    key=lambda item: files.index(item.path.stem),
                )
                code = int(any(fails(session, item) for item in items))
            finally:
                os._exit(code)
        return os.waitpid(child, 0)[1] == 0


def fails(session, item) -> bool:
    """Run one test, and say whether it failed."""
    session.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
    return bool(session.testsfailed)


def plant(name: str, tree: ast.Module) -> None:
    """Run a changed source and put its functions, methods and numbers wherever the old ones are known."""
    fresh = vars(sys.modules[name])
    old = dict(fresh)
    fresh["float_like"] = lambda value: value
    exec(compile(tree, name, "exec"), fresh)
    classes = {key for key, value in old.items() if isinstance(value, type)}
    for key in classes:
        take_methods(name, old[key], fresh[key])
    changed = {key: fresh[key] for key in old.keys() - classes if fresh[key] is not old[key] and key[:2] != "__"}
    for other in [module for key, module in sys.modules.items() if key.startswith("guidance") or "test_" in key]:
        for key in changed.keys() & vars(other).keys():
            if vars(other)[key] is old[key]:
                setattr(other, key, changed[key])
    fresh.update({key: old[key] for key in classes})


def take_methods(name: str, old: type, fresh: type) -> None:
    """Give a class that others know the methods of its changed twin."""
    for key, method in vars(fresh).items():
        if inspect.isfunction(method) and fresh.__module__ == name:
            setattr(old, key, method)


def say(line: str) -> None:
    """Print past pytest's capture."""
    os.write(REPORT, f"{line}\n".encode())


def main() -> None:
    """Draw mutants at random until all are judged or the time is up."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="comma-separated modules")
    parser.add_argument("--lines", default="", help="comma-separated line numbers, to judge some again")
    given = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    os.chdir(ROOT)
    drawn = []
    for path in sorted(SOURCE.glob("*.py")):
        if path.stem in ("__init__", "reasons") or (given.only and path.stem not in given.only.split(",")):
            continue
        drawn += [(path.stem, said, tree) for said, tree in mutants(strip(ast.parse(path.read_text())))]
    if given.lines:
        drawn = [entry for entry in drawn if entry[1].split(":")[0] in given.lines.split(",")]
    random.Random(given.seed).shuffle(drawn)
    settings.register_profile(
        "mutants",
        phases=[Phase.explicit, Phase.generate],
        database=None,
        derandomize=True,
        max_examples=20,
        deadline=None,
    )
    settings.load_profile("mutants")
    files = sorted({str(TESTS / f"{name}.py") for stem, _, _ in drawn for name in COVERING.get(stem, CORE)})
    options = ["-q", "-p", "no:cacheprovider", "--assert=plain", f"--rootdir={ROOT}"]
    pytest.main([*options, *files], plugins=[Forks(drawn, time.monotonic() + 60.0 * given.minutes)])


def strip(tree: ast.Module) -> ast.Module:
    """Leave annotations and messages alone: they change no result."""

    class Quiet(ast.NodeTransformer):
        def visit_JoinedStr(self, node):
            return ast.Constant("message")

        def visit_AnnAssign(self, node):
            node.annotation = ast.Constant("annotation") if not isinstance(node.target, ast.Name) else node.annotation
            return self.generic_visit(node)

        def visit_FunctionDef(self, node):
            node.returns = None
            for argument in (*node.args.args, *node.args.kwonlyargs):
                argument.annotation = None
            return self.generic_visit(node)

    return Quiet().visit(tree)


if __name__ == "__main__":
    main()
