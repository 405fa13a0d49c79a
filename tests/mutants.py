"""Mutation tests of the code that keeps people safe: `python -m tests mutants [FILE ...]`.

One operator, number, argument or word is changed at a time, as mutmut does, and a test has to notice.
`tests/mutants.toml` lists the mutants that no test can notice, each with the reason. The step fails if another one
survives, and if a listed one does not exist any more or is noticed. Its rule `letters` lists the mutants that change
only the letters of a text for people: tests do not repeat texts.

Each file is judged by the tests that concern it (`TESTS`), up to the first failure. Tests of more than 0.2 s of
processor time (tests/costly.txt) judge nothing. One process collects the tests and forks for every mutant. The fork
replaces the code of the mutant's function, and runs the tests that reach that function. What a module computes when it
is imported (its tables, constants and defaults) has the same mutants; their forks import the project again.
"""

import argparse
import ast
import contextlib
import fnmatch
import inspect
import json
import math
import os
import re
import resource
import signal
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from importlib import import_module
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

ROOT = Path(__file__).parent.parent
LISTED = Path(__file__).with_suffix(".toml")
PACKAGES = ("guidance", "sitl_mock", "tests")

WALLS = (
    "tests/control/test_braking_law.py",
    "tests/control/test_walls.py",
    "tests/control/test_constraints.py",
    "tests/control/test_held_back.py",
    "tests/control/test_braked.py::test_a_vehicle_brakes_if_drift_and_stopping_distance_exceed_the_room",
    "tests/control/test_braked.py::test_every_wall_is_braked_for_as_its_law_asks_and_nothing_along_it",
    "tests/control/test_braked.py::test_a_vehicle_brakes_for_the_wall_ahead_beside_a_near_one_that_it_leaves",
)
LIMITER = (
    "tests/control/test_setpoint_limiter.py",
    "tests/control/test_setpoint_limiter_any_input.py",
)
PREFLIGHT = (
    "tests/preflight/test_judging_parameters.py",
    "tests/preflight/test_judging_mending.py",
    "tests/preflight/test_rows.py",
    "tests/preflight/test_telemetry.py",
    "tests/preflight/test_fence.py",
)
FLIGHT = (
    "tests/flight/test_machine.py",
    "tests/flight/test_authority.py",
    "tests/flight/test_playing.py",
    "tests/flight/test_machine_notes.py",
    "tests/flight/test_machine_faults.py",
    "tests/flight/test_machine_operator.py",
    "tests/flight/test_second_sender.py",
    "tests/flight/test_home.py",
    "tests/flight/test_loss_time.py",
    "tests/flight/test_late.py",
)
ANSWERS = (
    "tests/session/test_answers.py",
    "tests/session/test_orders_foreseen.py",
    "tests/flight/test_freshness.py",
    "tests/flight/test_far_evader.py",
    "tests/flight/test_second_sender.py",
    "tests/flight/test_late.py",
)
SOCKET = tuple(
    f"tests/session/test_control_socket.py::test_{name}"
    for name in (
        "an_order_arrives_with_its_giver_and_is_answered",
        "without_a_token_or_a_daemon_there_is_no_answer",
        "a_socket_left_by_a_killed_daemon_counts_as_none_and_is_replaced",
        "another_token_another_name_and_an_unknown_order_are_errors",
        "the_socket_has_the_rights_of_the_token_file",
        "a_path_too_long_for_the_kernel_works",
        "whatever_is_sent_orders_nothing_and_the_next_order_is_taken",
        "a_daemon_of_an_older_version_gets_no_order_that_is_meant_for_a_team",
        "orders_are_taken_again_after_a_moment_without_a_free_descriptor",
    )
)
"""Those that start no process: another process imports the file as it is on the disk."""
TESTS: Mapping[str, Sequence[str]] = {
    "guidance/vehicle.py": (
        "tests/test_vehicle_jumps.py",
        "tests/test_plausible.py",
        "tests/test_vehicle.py",
    ),
    "guidance/control/braking_law.py": WALLS,
    "guidance/control/limits.py": (
        "tests/control/test_envelope.py",
        "tests/control/test_limits.py",
    ),
    "guidance/control/polygon.py": ("tests/control/test_polygon.py", *WALLS),
    "guidance/control/setpoint_limiter.py": LIMITER,
    "guidance/flight/table.py": ("tests/flight/test_table.py",),
    "guidance/flight/detection.py": (
        "tests/flight/test_detection.py",
        "tests/flight/test_arming.py",
        "tests/flight/test_freshness.py",
        "tests/flight/test_far_evader.py",
        *FLIGHT,
    ),
    "guidance/flight/machine.py": FLIGHT,
    "guidance/flight/freshness.py": ("tests/flight/test_ages.py", "tests/flight/test_freshness.py"),
    "guidance/autopilots/rules.py": ("tests/autopilots/test_rules.py", *PREFLIGHT),
    "guidance/preflight/changing.py": PREFLIGHT,
    "guidance/preflight/judging.py": PREFLIGHT,
    "guidance/preflight/parameters.py": PREFLIGHT,
    "guidance/preflight/reading.py": PREFLIGHT,
    "guidance/preflight/areas.py": (
        "tests/preflight/test_areas.py",
        "tests/preflight/test_fence.py",
    ),
    "guidance/preflight/fence.py": (
        "tests/preflight/test_fence.py",
        "tests/preflight/test_rows.py",
    ),
    "guidance/session/orders/answers.py": ANSWERS,
    "guidance/session/orders/control_bus.py": ("tests/session/test_control_bus_queries.py",),
    "guidance/session/orders/control_client.py": ("tests/session/test_control_client.py",),
    "guidance/session/orders/control_socket.py": (
        "tests/session/test_control_exchange.py",
        "tests/test_pipes.py::test_a_moment_without_a_thread_ends_no_order_socket",
        *SOCKET,
    ),
    "guidance/session/orders/control_token.py": ("tests/session/test_control_token.py", *SOCKET),
    "guidance/session/orders/mailbox.py": ("tests/session/test_orders.py",),
    "guidance/session/orders/replies.py": ("tests/session/test_replies.py",),
    "guidance/session/orders/socket_client.py": ("tests/session/test_socket_client.py",),
    "guidance/session/orders/words.py": (
        "tests/session/test_orders.py",
        "tests/session/test_control_socket.py",
        "tests/session/test_orders_foreseen.py",
    ),
}
"""The tests that judge the mutants of each file."""

FUNCTIONS_ONLY = frozenset({"guidance/control/limits.py"})
"""Files whose tables are not mutated: defaults and bounds of the vehicle file, which only a copy would notice."""

PYTEST = (
    "-q", "-s", "--tb=no", "--assert=plain", "-p", "pytest_asyncio.plugin", "-p", "_hypothesis_pytestplugin",
    "-p", "no:cacheprovider", "-m", "not costly and not slow and not flight and not long and not arrays",
)  # fmt: skip
ENVIRONMENT = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "HYPOTHESIS_PROFILE": "mutants"}

LONGEST_S = 300
"""Time after which a fork counts as noticed; it may wait for something that never comes."""

LEAST_PROCESSOR_S = 10.0
"""Processor time that a fork may use, beside four times that of its tests."""

MODULE = "module"
"""Stands for the function of a mutant that is in none."""

STRING = re.compile(r"""(?:"[^"]*"|'[^']*')""")


class Mutant(NamedTuple):
    """A change in a function: the lines before and after."""

    function: str
    line: str
    becomes: str


class Change(NamedTuple):
    """How a mutant is made: the code of its function, or None where the module's source has to be imported."""

    mutant: Mutant
    code: CodeType | None
    source: Callable[[], str]


def main(arguments: Sequence[str]) -> int:
    """Judge the files named, or all; return 1 if a survivor is not listed, or a listed mutant is none."""
    parser = argparse.ArgumentParser(prog="python -m tests mutants", description=__doc__)
    parser.add_argument("files", nargs="*", metavar="FILE", help="all of them if none is named")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N")
    parser.add_argument(
        "--only", action="append", metavar="PATTERN", help=f"names of functions, or {MODULE}"
    )
    options = parser.parse_args(arguments)
    names = [os.path.relpath(Path(name).resolve(), ROOT) for name in options.files]
    unknown = [name for name in names if name not in TESTS]
    if unknown:
        print(f"no tests of mutants for {', '.join(unknown)}: choose from {', '.join(TESTS)}")
        return 2
    os.chdir(ROOT)
    os.environ |= ENVIRONMENT
    listed = listed_mutants()
    failed = False
    for name in names or TESTS:
        started_s = time.perf_counter()
        used_s = _processor_s()
        judged = _judged(name, options.jobs, options.only or ["*"])
        survivors = {mutant for mutant, survives in judged if survives}
        equivalent = [mutant for mutant in listed.get(name, ()) if mutant in survivors]
        worded = [mutant for mutant in survivors if changes_letters(mutant)]
        print(
            f"{name}: {len(judged)} mutants, {len(survivors)} survive, "
            f"{len(equivalent)} of them are listed and {len(worded)} more by the rule on letters; "
            f"{time.perf_counter() - started_s:.0f} s, {_processor_s() - used_s:.0f} s of processor time",
            flush=True,
        )
        mutants = Counter(mutant for mutant, _ in judged)
        whole = options.only is None
        for fault in faults_of(name, mutants, survivors, listed.get(name, ()), whole=whole):
            failed = True
            print(fault, flush=True)
    if not failed:
        print("every mutant is noticed or listed")
    return int(failed)


def listed_mutants() -> dict[str, list[Mutant]]:
    """Return the mutants that are listed as equivalent, by file."""
    entries = tomllib.loads(LISTED.read_text(encoding="utf-8"))
    listed: dict[str, list[Mutant]] = {}
    for entry in entries.get("mutant", ()):
        if not entry["why"]:
            raise ValueError(f"{LISTED.name}: {entry}: has no reason")
        mutant = Mutant(entry["function"], entry["line"].strip(), entry["becomes"].strip())
        listed.setdefault(entry["file"], []).append(mutant)
    return listed


def faults_of(
    name: str,
    mutants: Mapping[Mutant, int],
    survivors: Collection[Mutant],
    listed: Sequence[Mutant],
    *,
    whole: bool,
) -> Iterator[str]:
    """Yield the survivors that are not listed, and the listed mutants that do not survive.

    Args:
        name: Of the file.
        mutants: The mutants that were judged.
        survivors: Those that no test noticed.
        listed: Those that no test can notice.
        whole: Whether all functions of the file were mutated.
    """
    for mutant in survivors:
        if mutant not in listed and not changes_letters(mutant):
            yield f"{name}: survives: in {mutant.function}\n  - {mutant.line}\n  + {mutant.becomes}"
    for mutant, count in Counter(listed).items():
        if mutant in mutants and mutant not in survivors:
            yield f"{name}: listed, but noticed: in {mutant.function}: {mutant.becomes}"
        elif whole and mutant not in mutants:
            yield f"{name}: listed, but no mutant: in {mutant.function}: {mutant.becomes}"
        elif count > 1:
            yield f"{name}: listed {count} times: in {mutant.function}: {mutant.becomes}"


def changes_letters(mutant: Mutant) -> bool:
    """Whether a mutant changes nothing but the letters of a text for people: a string with a blank in it."""
    before = STRING.findall(mutant.line)
    after = STRING.findall(mutant.becomes)
    if STRING.sub("", mutant.line) != STRING.sub("", mutant.becomes) or len(before) != len(after):
        return False
    changed = [text for text, mutated in zip(before, after, strict=True) if text != mutated]
    return bool(changed) and all(" " in text for text in changed)


def _processor_s() -> float:
    """Return the processor time of this process and of its children that have ended."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


def _judged(name: str, jobs: int, patterns: Sequence[str]) -> list[tuple[Mutant, bool]]:
    """Judge the mutants of one file in the functions whose names match; return whether each survives."""
    import pytest

    changes = [
        change
        for change in changes_of(undecorated((ROOT / name).read_text(encoding="utf-8")))
        if any(_is_named(change.mutant.function, pattern) for pattern in patterns)
        and not (change.mutant.function == MODULE and name in FUNCTIONS_ONLY)
    ]
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        judge = Judge(name, changes, jobs, Path(folder))
        pytest.main([*PYTEST, *TESTS[name]], plugins=[Loop(judge.judge)])
    if len(judge.survives) != len(changes):
        raise RuntimeError(f"the tests of {name} fail without a mutant: {judge.broken}")
    return [(change.mutant, judge.survives[number]) for number, change in enumerate(changes)]


def _is_named(function: str, pattern: str) -> bool:
    last = function.rpartition(".")[2]
    return fnmatch.fnmatchcase(function, pattern) or fnmatch.fnmatchcase(last, pattern)


class Loop:
    """A pytest plugin that calls a function where the tests would run, and knows the last one that failed."""

    def __init__(self, call: Callable[[Any, "Loop"], None]) -> None:
        self._call = call
        self.failed = ""

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Note a failure, also of a test that had no processor when it needed one (tests/conftest.py)."""
        if report.failed or getattr(report, "starved", ""):
            self.failed = report.nodeid

    def pytest_runtestloop(self, session: Any) -> bool:
        """Call the function if the tests were collected."""
        if not session.testsfailed:
            self._call(session, self)
        return True

    def first_failure(self, session: Any, items: Sequence[Any]) -> str:
        """Run tests until one fails; return its name."""
        for item, following in zip(items, [*items[1:], None], strict=True):
            session.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            if self.failed:
                break
        return self.failed


class Judge:
    """Judges the mutants of a file in forks of the process that has collected its tests.

    Args:
        name: Of the file.
        changes: The mutants.
        jobs: How many are judged at the same time.
        folder: Where forks write the name of the test that failed, or nothing.

    Attributes:
        survives: Whether each mutant survives, by its number.
        broken: Why nothing is judged.
    """

    def __init__(self, name: str, changes: Sequence[Change], jobs: int, folder: Path) -> None:
        self._name = name
        self._module = name.removesuffix(".py").replace("/", ".")
        self._changes = changes
        self._jobs = jobs
        self._folder = folder
        self._took_s: dict[str, float] = {}
        self._orders: dict[str, list[str]] = {}
        self._forks: dict[int, int] = {}
        self.survives: dict[int, bool] = {}
        self.broken = "they cannot be collected"

    def judge(self, session: Any, loop: Loop) -> None:
        """Run the tests without a mutant, then with each."""
        measured = self._folder / "measured"
        source = (ROOT / self._name).read_text(encoding="utf-8")
        os.waitpid(_fork(lambda: self._measure(source, session, loop, measured), math.inf), 0)
        self._took_s, reached, self.broken = json.loads(measured.read_text(encoding="utf-8"))
        if self.broken:
            return
        tests = sorted(self._took_s, key=self._took_s.__getitem__)
        imported = self._folder / "imported"
        os.waitpid(_fork(lambda: self._import(lambda: source, tests[:1], imported), math.inf), 0)
        self.broken = imported.read_text(encoding="utf-8")
        if self.broken:
            return
        items = {item.nodeid: item for item in session.items}
        for number, change in enumerate(self._changes):
            while len(self._forks) >= self._jobs:
                self._take()
            report = self._folder / str(number)
            function = change.mutant.function
            # A function that no test reaches may be called as its module is imported.
            if change.code is None or function not in reached:
                order = self._orders.setdefault(MODULE, tests)
                work = partial(self._import, change.source, order, report)
            else:
                order = self._orders.setdefault(
                    function, sorted(reached[function], key=tests.index)
                )
                chosen = [items[name] for name in order]
                live = self._live(function)

                def work(live=live, code=change.code, chosen=chosen, report=report) -> None:
                    live.__code__ = code
                    report.write_text(loop.first_failure(session, chosen), encoding="utf-8")

            processor_s = LEAST_PROCESSOR_S + 4.0 * sum(self._took_s[name] for name in order)
            self._forks[_fork(work, processor_s)] = number
        while self._forks:
            self._take()

    def _take(self) -> None:
        """Wait for a fork; the test that noticed its mutant comes first for the next mutant of that function."""
        pid, _ = os.wait()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)  # what its tests have started
        number = self._forks.pop(pid)
        report = self._folder / str(number)
        failed = report.read_text(encoding="utf-8") if report.exists() else "ended by a limit"
        self.survives[number] = not failed
        for order in (
            self._orders.get(self._changes[number].mutant.function),
            self._orders.get(MODULE),
        ):
            if order and failed in order:
                order.remove(failed)
                order.insert(0, failed)

    def _measure(self, source: str, session: Any, loop: Loop, report: Path) -> None:
        """Run every test; report how long each takes, which functions of the file it reaches, and which one failed."""
        import coverage

        path = str(ROOT / self._name)
        watch = coverage.Coverage(data_file=None, include=[path], config_file=False)
        watch.start()
        took_s = {}
        for item, following in zip(session.items, [*session.items[1:], None], strict=True):
            watch.switch_context(item.nodeid)
            began_s = _processor_s()
            session.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            took_s[item.nodeid] = _processor_s() - began_s
        watch.stop()
        by_line = watch.get_data().contexts_by_lineno(path)
        reached = {}
        for function, node in functions_of(ast.parse(source)):
            lines = range(node.body[0].lineno, node.end_lineno + 1)
            if names := {name for line in lines for name in by_line.get(line, ()) if name}:
                reached[function] = sorted(names)
        report.write_text(json.dumps((took_s, reached, loop.failed)), encoding="utf-8")

    def _import(self, source: Callable[[], str], order: Sequence[str], report: Path) -> None:
        """Collect the tests again with the modules of the project, one of which has this source; run them."""
        import pytest

        text = source()
        get_code = SourceFileLoader.get_code

        def code_of(loader: SourceFileLoader, module: str) -> CodeType | None:
            if module == self._module:
                return compile(text, str(ROOT / self._name), "exec")
            return get_code(loader, module)

        def run(session: Any, loop: Loop, chosen: Sequence[str]) -> None:
            items = {item.nodeid: item for item in session.items}
            failed = loop.first_failure(session, [items[name] for name in chosen])
            report.write_text(failed, encoding="utf-8")

        SourceFileLoader.get_code = code_of
        # The file of the test that comes first may be enough, and is collected faster than all of them.
        first = order[0].partition("::")[0]
        in_first = [name for name in order if name.partition("::")[0] == first]
        others = [name for name in order if name not in in_first]
        for files, chosen in (([first], in_first), (TESTS[self._name], others)):
            for module in list(sys.modules):
                if module.partition(".")[0] in PACKAGES:
                    del sys.modules[module]
            report.write_text("cannot be imported", encoding="utf-8")
            pytest.main([*PYTEST, *files], plugins=[Loop(partial(run, chosen=chosen))])
            if report.read_text(encoding="utf-8") or not others:
                break

    def _live(self, function: str) -> Any:
        """Return a function of the module, without its decorators."""
        found: Any = import_module(self._module)
        for name in function.split("."):
            found = vars(found)[name]
        found = getattr(found, "fget", None) or getattr(found, "__func__", found)
        return inspect.unwrap(found)


def _fork(work: Callable[[], object], processor_s: float) -> int:
    """Do some work in a silent fork with limits; return its process id."""
    if pid := os.fork():
        return pid
    try:
        os.setpgid(0, 0)
        nothing = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(nothing, stream)
        if processor_s < math.inf:
            signal.alarm(LONGEST_S)
            limit_s = math.ceil(processor_s)
            resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
        work()
    finally:
        os._exit(0)


def undecorated(source: str) -> str:
    """Return the source without decorators of properties, contexts and caches, for mutmut leaves those functions out.

    A property or context is assigned after its function. A cache is left out, because it would keep what another mutant
    returned.
    """
    lines = source.splitlines()
    decorated = [
        node
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef) and len(node.decorator_list) == 1
    ]
    for node in sorted(decorated, key=lambda node: node.lineno, reverse=True):
        decorator = ast.unparse(node.decorator_list[0])
        if decorator in {"property", "contextlib.contextmanager"}:
            lines.insert(
                node.end_lineno, f"{' ' * node.col_offset}{node.name} = {decorator}({node.name})"
            )
        elif not decorator.startswith("lru_cache"):
            continue
        del lines[node.decorator_list[0].lineno - 1]
    return "\n".join(lines) + "\n"


def functions_of(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Yield the functions of a module and the methods of its classes, by name."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name, node
        elif isinstance(node, ast.ClassDef):
            for method in node.body:
                if isinstance(method, ast.FunctionDef | ast.AsyncFunctionDef):
                    yield f"{node.name}.{method.name}", method


def changes_of(source: str) -> Iterator[Change]:
    """Yield the mutants of a module.

    Outside of functions, texts are left out, and so are assignments of None, which would stop the import.
    """
    import libcst
    from mutmut.mutation.file_mutation import MutationVisitor, deep_replace
    from mutmut.mutation.mutators import mutation_operators
    from mutmut.mutation.pragma_handling import IgnoredCode

    left_out = (libcst.BaseString, libcst.Assign, libcst.AnnAssign)
    visitor = MutationVisitor(mutation_operators, IgnoredCode(set(), set(), set()))
    module = libcst.MetadataWrapper(libcst.parse_module(source)).visit(visitor)
    classes = [statement for statement in module.body if isinstance(statement, libcst.ClassDef)]
    owners = {method: owner for owner in classes for method in owner.body.body}

    def text_of(node: Any, owner: Any) -> str:
        """Return the source of a function, alone in its class if it has one."""
        if owner is not None:
            node = owner.with_changes(body=owner.body.with_changes(body=[node]))
        return module.code_for_node(node)

    for mutation in visitor.mutations:
        node = mutation.contained_by_top_level_function
        names = []
        if isinstance(node, libcst.FunctionDef):
            names = [part.name.value for part in (owners.get(node), node) if part is not None]
        elif isinstance(mutation.original_node, left_out):
            continue
        else:
            node = module
        owner = owners.get(node)
        changed = deep_replace(node, mutation.original_node, mutation.mutated_node)
        before = text_of(node, owner)
        after = text_of(changed, owner)
        yield Change(
            _change(".".join(names) or MODULE, before.splitlines(), after.splitlines()),
            _changed_code(names, before, after),
            partial(_whole, module, node, changed),
        )


def _whole(module: Any, node: Any, changed: Any) -> str:
    """Return the source of a module with one changed node."""
    return changed.code if node is module else module.deep_replace(node, changed).code


def _changed_code(names: Sequence[str], before: str, after: str) -> CodeType | None:
    """Return the code of a function; None if there is none, or if something else than its body changes."""
    codes = []
    for text in (before, after):
        code = compile(text, "", "exec")
        for name in names:
            inner = (one for one in code.co_consts if isinstance(one, CodeType))
            code = next(one for one in inner if one.co_name == name)
        codes.append(code)
    same_names = codes[0].co_freevars == codes[1].co_freevars
    return codes[1] if names and same_names and codes[0] != codes[1] else None


def _change(function: str, before: Sequence[str], after: Sequence[str]) -> Mutant:
    """Return what differs between two bodies."""
    shorter = min(len(before), len(after))
    first = next((n for n in range(shorter) if before[n] != after[n]), shorter)
    rest = shorter - first
    kept = next((n for n in range(rest) if before[-1 - n] != after[-1 - n]), rest)
    removed = " ".join(line.strip() for line in before[first : len(before) - kept])
    added = " ".join(line.strip() for line in after[first : len(after) - kept])
    return Mutant(function, removed, added)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
