"""What can be changed in a file for a mutation run: one operator, comparison, constant, condition or choice at a time.

Annotations and the wording of messages are left alone: they change no result. So are the arguments `strict` of zip and
those of a dataclass decorator, which guard against other mistakes.
"""

import ast
import copy
import hashlib
import os
import resource
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "guidance" / "game"
WALL_S = 1800

SWAPS = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
    ast.USub: ast.UAdd, ast.FloorDiv: ast.Mult,
}  # fmt: skip
REVERSED = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}


class Change(NamedTuple):
    """A changed statement of a file.

    Attributes:
        place: Which statement of the file's outermost ones holds it.
        function: Outermost function or method that holds it, `Class.method`; empty outside of all.
        said: What was changed, and from what.
        line: Where.
        lines: The lines of the innermost statement, of a compound one those of its head, of a default's function all.
        tree: That outermost statement, changed.
    """

    place: int
    function: str
    said: str
    line: int
    lines: range
    tree: ast.stmt


def changes_of(tree: ast.Module) -> Iterator[Change]:
    """Yield every change that can be made to a file."""
    functions = functions_by_line(tree)
    for place, outermost in enumerate(tree.body):
        left_alone = set(map(id, _wordings(outermost)))
        statements = _innermost_statements(outermost)
        for index, node in enumerate(ast.walk(outermost)):
            for number, (said, _) in enumerate(() if id(node) in left_alone else changes(node)):
                changed = copy.deepcopy(outermost)
                target = next(other for at, other in enumerate(ast.walk(changed)) if at == index)
                list(changes(target))[number][1]()
                line = getattr(node, "lineno", 0)
                text = f"{said}: {ast.unparse(node)[:90]}".splitlines()[0]
                lines = _head(statements[id(node)])
                yield Change(place, functions.get(line, ""), text, line, lines, ast.fix_missing_locations(changed))


def mutants(tree: ast.Module) -> Iterator[tuple[str, ast.Module]]:
    """Yield a description and a changed file for every change that can be made."""
    for one in changes_of(tree):
        body = [*tree.body[: one.place], one.tree, *tree.body[one.place + 1 :]]
        yield f"{one.line}: {one.said}", ast.Module(body, tree.type_ignores)


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


def _wordings(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of annotations, messages and guards."""
    for node in ast.walk(tree):
        apart: list[Any] = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        if getattr(getattr(node, "annotation", None), "id", "") == "TypeAlias" or isinstance(node, ast.JoinedStr):
            apart.append(node)
        if isinstance(node, ast.ClassDef):
            apart += node.decorator_list
        if isinstance(node, ast.Call):
            apart += [keyword for keyword in node.keywords if keyword.arg == "strict"]
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING":
            apart.append(node)
        for part in filter(None, apart):
            yield from ast.walk(part)


def _innermost_statements(tree: ast.stmt) -> dict[int, ast.stmt]:
    """Name the innermost statement that holds each node."""
    held = {id(tree): tree}
    for node in ast.walk(tree):
        for child in ast.iter_child_nodes(node):
            held[id(child)] = child if isinstance(child, ast.stmt) else held[id(node)]
    return held


def _head(statement: ast.stmt) -> range:
    """Return the lines of a statement, of a compound one those before its first inner statement, of a function all."""
    if isinstance(statement, ast.FunctionDef):
        return range(statement.lineno, (statement.end_lineno or statement.lineno) + 1)
    body = getattr(statement, "body", None)
    last = max(statement.lineno, body[0].lineno - 1) if isinstance(body, list) else statement.end_lineno
    return range(statement.lineno, (last or statement.lineno) + 1)


class Mutant(NamedTuple):
    """A change to a file, and what it is called: file, function, change, and a number where several are alike.

    `digest` is what is kept of it: of what it does, so that docstrings and annotations may change.
    """

    stem: str
    function: str
    said: str
    line: int
    lines: range
    place: int
    text: str
    digest: str

    @property
    def named(self) -> str:
        """How it is listed."""
        return f"{self.function}: {self.said}"

    def __str__(self) -> str:
        return f"{self.stem}.py:{self.line}: {self.named}"


def modules() -> dict[str, Path]:
    """Return the files of the package by the names that they are imported by, without `guidance.game.`."""
    paths = {".".join(path.relative_to(SOURCE).with_suffix("").parts): path for path in SOURCE.rglob("*.py")}
    return {stem: path for stem, path in sorted(paths.items()) if path.stem != "__init__"}


def drawn_from(stem: str) -> Iterator[Mutant]:
    """Yield every mutant of a file that differs from it and from the others."""
    tree = ast.parse(modules()[stem].read_text())
    alike: Counter[tuple[str, str]] = Counter()
    known = {(place, bare(compile(ast.Module([one], []), "", "exec"))) for place, one in enumerate(tree.body)}
    for one in changes_of(tree):
        alike[one.function, one.said] += 1
        number = alike[one.function, one.said]
        code = (one.place, bare(compile(ast.Module([one.tree], []), "", "exec")))
        if code not in known:
            known.add(code)
            said = one.said if number == 1 else f"{one.said} ({number})"
            text = ast.unparse(one.tree)
            digest = hashlib.blake2b(f"{stem}\n{_undressed(text)}".encode(), digest_size=8).hexdigest()
            yield Mutant(stem, one.function, said, one.line, one.lines, one.place, text, digest)


def _undressed(text: str) -> str:
    """Return a statement without its docstrings and annotations."""
    return ast.unparse(ast.fix_missing_locations(_Undress().visit(ast.parse(text))))


class _Undress(ast.NodeTransformer):
    """Takes docstrings and annotations away."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.returns = None
        return self.generic_visit(node)

    def visit_arg(self, node: ast.arg) -> ast.AST:
        node.annotation = None
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        return self.generic_visit(ast.Assign([node.target], node.value or ast.Constant(...)))

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        words = isinstance(getattr(node.value, "value", None), str)
        return ast.Expr(ast.Constant("")) if words else self.generic_visit(node)


def bare(code: CodeType) -> tuple[object, ...]:
    """Return what code does, without where it was written."""
    constants = tuple(bare(one) if isinstance(one, CodeType) else (type(one), repr(one)) for one in code.co_consts)
    return code.co_qualname, code.co_code, constants, code.co_names, code.co_varnames, code.co_freevars


def in_child(
    work: Callable[[Callable[[str], None]], int], wall_s: int = WALL_S, heard: Callable[[str], None] | None = None
) -> tuple[int, str]:
    """Do something in a forked child; return how it ended, as of `os.waitpid`, and the lines it told."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        code = 70
        try:
            os.close(read)
            silence = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silence, 1)
            os.dup2(silence, 2)
            signal.alarm(wall_s)
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            with os.fdopen(write, "w", buffering=1) as out:
                code = work(lambda text: print(text, file=out, flush=True))
        finally:
            os._exit(code)
    os.close(write)
    lines = []
    with os.fdopen(read) as told:
        for line in told:
            lines.append(line.rstrip("\n"))
            if heard:
                heard(lines[-1])
    return os.waitpid(child, 0)[1], "\n".join(lines)
