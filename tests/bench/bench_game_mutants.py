"""Mutants of guidance.game: `python tests/bench/bench_game_mutants.py [--minutes M] [--seed S] [--only FILE]`.

One operator, comparison, constant or condition is changed at a time, in memory, in a forked child that runs the tests
of that file and stops at the first failure; no file is touched. Printed: how many were killed, and every survivor with
its place and change, for a person to judge whether it changes a result.
"""

import argparse
import ast
import copy
import importlib.util
import os
import random
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCE, TESTS = ROOT / "guidance" / "game", ROOT / "tests" / "game"
LIMIT_S = 240
CORE = ("test_solve_closed_forms", "test_degenerate_states", "test_bad_input", "test_brute_force", "test_batch_bits")
COVERING = {
    "apollonius": ("test_solve_closed_forms", "test_bad_input"),
    "batch": ("test_batch_bits",),
    "gradient": ("test_hji",),
    "hji": ("test_hji",),
    "policies": ("test_policies", "test_bad_input", "test_degenerate_states", "test_batch_bits"),
    "rollout": ("test_rollout", "test_bad_input"),
    "stepping": ("test_rollout", "test_bad_input"),
    "terminal": ("test_rollout",),
    "search": ("test_brute_force", "test_degenerate_states", "test_symmetry", "test_batch_bits"),
    "reach": ("test_solve_closed_forms", "test_degenerate_states", "test_policies", "test_brute_force", "test_rollout"),
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


class Planted:
    """An import hook that gives one module a changed source."""

    def __init__(self, name: str, tree: ast.Module) -> None:
        self.name, self.tree = name, tree

    def find_spec(self, name, path=None, target=None):
        return importlib.util.spec_from_loader(name, self) if name == self.name else None

    def create_module(self, spec):
        return None

    def exec_module(self, module) -> None:
        module.float_like = lambda value: value
        exec(compile(self.tree, self.name, "exec"), module.__dict__)


def survives(stem: str, tree: ast.Module) -> bool:
    """Run the tests of a file against a mutant in a child; a child that hangs or dies has been noticed."""
    child = os.fork()
    if child == 0:
        signal.alarm(LIMIT_S)
        os.setpgid(0, 0)
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        code = 1
        try:
            code = run_tests(stem, tree)
        finally:
            os._exit(code)
    return os.waitpid(child, 0)[1] == 0


def run_tests(stem: str, tree: ast.Module) -> int:
    """Run the tests in this process and return 0 if all passed."""
    import pytest
    from hypothesis import Phase, settings

    settings.register_profile(
        "mutants",
        phases=[Phase.explicit, Phase.generate],
        database=None,
        derandomize=True,
        max_examples=25,
        deadline=None,
    )
    settings.load_profile("mutants")
    sys.meta_path.insert(0, Planted(f"guidance.game.{stem}", tree))
    files = [str(TESTS / f"{name}.py") for name in COVERING.get(stem, CORE)]
    options = ["-x", "-q", "-p", "no:cacheprovider", "--no-header", "--assert=plain", f"--rootdir={ROOT}"]
    return int(pytest.main([*options, *files]))


def main() -> None:
    """Draw mutants at random until all are judged or the time is up."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="")
    parser.add_argument("--lines", default="", help="comma-separated line numbers, to judge some again")
    parser.add_argument("--trust", action="store_true", help="do not first run the tests without a change")
    given = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    os.chdir(ROOT)
    drawn = []
    for path in sorted(SOURCE.glob("*.py")):
        if path.stem in ("__init__", "reasons") or (given.only and given.only != path.stem):
            continue
        drawn += [(path.stem, said, tree) for said, tree in mutants(strip(ast.parse(path.read_text())))]
    if given.lines:
        drawn = [entry for entry in drawn if entry[1].split(":")[0] in given.lines.split(",")]
    random.Random(given.seed).shuffle(drawn)
    __import__("numpy"), __import__("hypothesis"), __import__("pytest"), __import__("array_api_compat")
    unchanged = {} if given.trust else {COVERING.get(stem, CORE): stem for stem, _, _ in drawn}
    for stem in unchanged.values():
        if not survives(stem, ast.parse((SOURCE / f"{stem}.py").read_text())):
            sys.exit(f"{stem}: its tests fail without any change")
    judge(drawn, time.monotonic() + 60.0 * given.minutes)


def judge(drawn: list[tuple[str, str, ast.Module]], ends: float) -> None:
    """Judge mutants until the time is up, and print the count."""
    killed, survivors = 0, []
    for stem, said, tree in drawn:
        if time.monotonic() > ends:
            break
        if survives(stem, tree):
            survivors.append((stem, said))
            print(f"survived: {stem}.py:{said}", flush=True)
        else:
            killed += 1
        if (killed + len(survivors)) % 20 == 0:
            print(f"judged so far: {killed + len(survivors)}, killed {killed}", file=sys.stderr, flush=True)
    judged = killed + len(survivors)
    print(f"{judged} of {len(drawn)} mutants judged, {killed} killed ({100.0 * killed / max(judged, 1):.1f} %), "
          f"{len(survivors)} survived")  # fmt: skip


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
