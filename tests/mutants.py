"""Mutation tests of the code that keeps people safe: `python -m tests mutants [FILE ...]`.

mutmut 3 changes one operator, number, argument or word at a time, and a test has to notice. `tests/mutants.toml` lists
the mutants that no test can notice, each with the reason. The step fails if another one survives, and if a listed one
does not exist any more or is noticed. Its rule `letters` lists the mutants that change only the letters of a text for
people: tests do not repeat texts.

Each file is mutated in a temporary copy of the project and judged by the tests that concern it (`TESTS`), the fastest
first, up to the first failure. Tests of more than 0.2 s of processor time (tests/costly.txt) judge nothing. mutmut
switches functions only. What a module computes when it is imported (its tables, constants and defaults) has the same
mutants, but each of them needs a process that imports it.
"""

import argparse
import ast
import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.util import cache_from_source
from pathlib import Path
from queue import Queue
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
LISTED = Path(__file__).with_suffix(".toml")
COPIED = ("guidance", "sitl_mock", "config", "tests")

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
    "tests/session/test_daemon.py",
    "tests/session/test_daemon_engaging.py",
)
BUS = (
    "tests/session/test_bad_mate.py",
    "tests/session/test_team_orders.py",
    "tests/session/test_control_bus.py",
)
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
    ),
    "guidance/flight/machine.py": FLIGHT,
    "guidance/flight/freshness.py": ("tests/flight/test_freshness.py",),
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
    "guidance/session/orders/control_bus.py": BUS,
    "guidance/session/orders/control_client.py": BUS,
    "guidance/session/orders/control_socket.py": ("tests/session/test_control_socket.py",),
    "guidance/session/orders/control_token.py": (
        "tests/session/test_control_token.py",
        "tests/session/test_control_socket.py",
    ),
    "guidance/session/orders/mailbox.py": (
        "tests/session/test_orders.py",
        "tests/session/test_daemon_engaging.py",
        "tests/session/test_uploaded_fence.py",
    ),
    "guidance/session/orders/replies.py": ("tests/session/test_replies.py",),
    "guidance/session/orders/socket_client.py": ("tests/session/test_control_socket.py",),
    "guidance/session/orders/words.py": (
        "tests/session/test_orders.py",
        "tests/session/test_control_socket.py",
        "tests/session/test_orders_foreseen.py",
    ),
}
"""The tests that judge the mutants of each file."""

FUNCTIONS_ONLY = frozenset({"guidance/control/limits.py"})
"""Files whose tables are not mutated: defaults and bounds of the vehicle file, which only a copy would notice."""

SETTINGS = """
[tool.mutmut]
source_paths = ["guidance"]
only_mutate = [{file}]
also_copy = ["sitl_mock", "config"]
pytest_add_cli_args = [
    "-p", "pytest_asyncio.plugin", "-p", "_hypothesis_pytestplugin", "-p", "tests.harness.fastest_first",
    "-p", "no:cacheprovider", "-m", {marks},
]
pytest_add_cli_args_test_selection = {tests}
timeout_multiplier = 4.0
use_git_change_detection = false
"""
SPINNER = "⠋⠙⠹⠸⠼⠴⠦⠧⠇⠏"
PYTEST = (
    sys.executable, "-m", "pytest", "-x", "-q", "-p", "pytest_asyncio.plugin", "-p", "_hypothesis_pytestplugin",
    "-p", "no:cacheprovider",
)  # fmt: skip
LONGEST_S = 120.0
MODULE = "module"
"""Stands for the function of a mutant that is in none."""

MARKS = "not costly and not slow and not flight and not long and not arrays"
ENVIRONMENT = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "HYPOTHESIS_PROFILE": "mutants"}

STRING = re.compile(r"""(?:"[^"]*"|'[^']*')""")

SURVIVED = {None: "not judged", 0: "survives", 2: "not judged", 5: "has no test", 33: "has no test"}
"""mutmut's exit codes of a mutant that was not noticed; the others are failures and time-outs."""


class Mutant(NamedTuple):
    """A change in a function: the lines before and after."""

    function: str
    line: str
    becomes: str


class Outcome(NamedTuple):
    """What became of a file's mutants: how many there are of each, and those that survived, with the reason."""

    mutants: Counter[Mutant]
    survivors: Mapping[Mutant, str]
    seconds: float
    processor_s: float


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
    only = options.only or ["*"]
    listed = listed_mutants()
    faults: list[str] = []
    for name in names or TESTS:
        outcome = _judged(name, options.jobs, only)
        equivalent = [mutant for mutant in listed.get(name, ()) if mutant in outcome.survivors]
        worded = [mutant for mutant in outcome.survivors if changes_letters(mutant)]
        print(
            f"{name}: {outcome.mutants.total()} mutants, {len(outcome.survivors)} survive, "
            f"{len(equivalent)} of them are listed and {len(worded)} more by the rule on letters; "
            f"{outcome.seconds:.0f} s, {outcome.processor_s:.0f} s of processor time",
            flush=True,
        )
        whole = "*" in only
        faults += faults_of(
            name, outcome.mutants, outcome.survivors, listed.get(name, ()), whole=whole
        )
    print("\n".join(faults) or "every mutant is noticed or listed")
    return int(bool(faults))


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
    survivors: Mapping[Mutant, str],
    listed: Sequence[Mutant],
    *,
    whole: bool,
) -> Iterator[str]:
    """Yield the survivors that are not listed, and the listed mutants that do not survive.

    Args:
        name: Of the file.
        mutants: The mutants that were judged.
        survivors: Those that no test noticed, with the reason.
        listed: Those that no test can notice.
        whole: Whether all functions of the file were mutated.
    """
    for mutant, reason in survivors.items():
        if mutant not in listed and not changes_letters(mutant):
            yield f"{name}: {reason}: in {mutant.function}\n  - {mutant.line}\n  + {mutant.becomes}"
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


def _judged(name: str, jobs: int, patterns: Sequence[str]) -> Outcome:
    """Judge the mutants of one file in a temporary copy of the project."""
    started_s = time.perf_counter()
    used_s = _processor_s()
    judged: list[tuple[Mutant, str]] = []
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = Path(folder)
        for package in COPIED:
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / package, copy / package, ignore=ignored)
        source = copy / name
        source.write_text(undecorated(source.read_text(encoding="utf-8")), encoding="utf-8")
        settings = SETTINGS.format(
            file=json.dumps(name), tests=json.dumps(list(TESTS[name])), marks=json.dumps(MARKS)
        )
        project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
        (copy / "pyproject.toml").write_text(project + settings, encoding="utf-8")
        if {"*", MODULE} & set(patterns) and name not in FUNCTIONS_ONLY:
            judged += _judged_modules(copy, name, jobs)
        if functions := [pattern for pattern in patterns if pattern != MODULE]:
            judged += _judged_functions(copy, name, jobs, functions)
    mutants = Counter(mutant for mutant, _ in judged)
    survivors = {mutant: reason for mutant, reason in judged if reason}
    seconds = time.perf_counter() - started_s
    return Outcome(mutants, survivors, seconds, _processor_s() - used_s)


def _processor_s() -> float:
    """Return the processor time of this process and of its children that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def _judged_functions(
    copy: Path, name: str, jobs: int, patterns: Sequence[str]
) -> Iterator[tuple[Mutant, str]]:
    """Run mutmut; yield each mutant and how it survived, or nothing."""
    command = [str(Path(sys.executable).parent / "mutmut"), "run", "--max-children", str(jobs)]
    if "*" not in patterns:
        command += [f"*x[_ǁ]{pattern}__mutmut_*" for pattern in patterns]
    done = subprocess.run(
        command,
        cwd=copy,
        env=os.environ | ENVIRONMENT,
        check=False,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    if done.returncode != 0:
        shown = done.stdout.decode(errors="replace").splitlines()
        words = "\n".join(line for line in shown if line[:1] not in SPINNER)
        raise RuntimeError(f"mutmut failed on {name}:\n{words}")
    mutated = copy / "mutants" / name
    codes = json.loads(Path(f"{mutated}.meta").read_text(encoding="utf-8"))["exit_code_by_key"]
    changes = changes_of(mutated.read_text(encoding="utf-8"))
    for key, code in codes.items():
        if code is not None or "*" in patterns:
            yield changes[key.rpartition(".")[2]], SURVIVED.get(code, "")


def _judged_modules(copy: Path, name: str, jobs: int) -> list[tuple[Mutant, str]]:
    """Judge what a module computes when it is imported; return each mutant and how it survived, or nothing."""
    source = (copy / name).read_text(encoding="utf-8")
    copies = Queue[Path]()
    for number in range(jobs):
        folder = copy / f"copy {number}"
        for package in COPIED:
            shutil.copytree(copy / package, folder / package)
        shutil.copy(copy / "pyproject.toml", folder)
        if not _passes(folder, name, {}):
            raise RuntimeError(f"the tests of {name} fail without a mutant")
        copies.put(folder)

    def judged(mutated: str) -> tuple[Mutant, str]:
        folder = copies.get()
        (folder / name).write_text(mutated, encoding="utf-8")
        Path(cache_from_source(folder / name)).unlink(missing_ok=True)  # of the mutant before
        passed = _passes(folder, name, {"PYTHONDONTWRITEBYTECODE": "1"})
        copies.put(folder)
        change = _change(MODULE, source.splitlines(), mutated.splitlines())
        return change, "survives" if passed else ""

    with ThreadPoolExecutor(jobs) as executor:
        return list(executor.map(judged, mutated_modules(copy, name)))


def mutated_modules(copy: Path, name: str) -> list[str]:
    """Return the mutants of a file in a project with settings of mutmut that are outside of functions.

    Texts are left out, and so are assignments of None, which would stop the import.
    """
    import libcst
    from mutmut.mutation.file_mutation import create_mutations, deep_replace

    left_out = (libcst.BaseString, libcst.Assign, libcst.AnnAssign)
    with contextlib.chdir(copy):
        module, mutations, *_ = create_mutations(name, Path(name).read_text(encoding="utf-8"))
    return [
        deep_replace(module, mutation.original_node, mutation.mutated_node).code
        for mutation in mutations
        if not isinstance(mutation.contained_by_top_level_function, libcst.FunctionDef)
        and not isinstance(mutation.original_node, left_out)
    ]


def _passes(folder: Path, name: str, environment: Mapping[str, str]) -> bool:
    """Run the tests of a file in a copy of the project."""
    try:
        done = subprocess.run(
            [*PYTEST, "-m", MARKS, *TESTS[name]],
            cwd=folder,
            env=os.environ | ENVIRONMENT | environment,
            check=False,
            capture_output=True,
            timeout=LONGEST_S,
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


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


def changes_of(mutated: str) -> dict[str, Mutant]:
    """Return the change of every mutant in a file that mutmut wrote, by mutmut's name for it."""
    lines = mutated.splitlines()
    functions = {
        node.name: lines[node.lineno - 1 : node.end_lineno]
        for node in ast.walk(ast.parse(mutated))
        if isinstance(node, ast.FunctionDef) and "__mutmut_" in node.name
    }
    changes = {}
    for name, body in functions.items():
        mangled, _, number = name.partition("__mutmut_")
        if number == "orig":
            continue
        function = mangled.removeprefix("x_").removeprefix("xǁ").replace("ǁ", ".")
        before = functions[f"{mangled}__mutmut_orig"]
        changes[name] = _change(function, before[1:], body[1:])
    return changes


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
