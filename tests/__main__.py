"""Runs the checks and tests of a change.

    python -m tests              format, lint, layers, types, the short tests and a sample of every longer proof
    python -m tests changed      what the changed files reach: their tests, and mutants of what keeps people safe
    python -m tests all          everything, as before a release; what passed on the same files is not repeated
    python -m tests durations    processor time of each test in the last runs
    python -m tests STEP ...     single steps

The steps of a lane run one after another, and the lanes side by side. The table at the end has a row for every step:
passed, failed or starved. A test in real time that fails while it has no processor is starved; it runs again alone at
the end, and if it starves again, the run fails.
"""

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path

ROOT = Path(__file__).parent.parent
BIN = Path(sys.executable).parent
KEPT = ROOT / ".pytest_cache"
TOP = ("pyproject.toml", "README.md", "CHANGELOG.md", ".mkdocs.yml", ".pre-commit-config.yaml")
PYTEST = (sys.executable, "-m", "pytest", "-q")
SHORT_S = 0.2
"""Most processor time of a test that runs without being asked for."""

COSTLY = Path(__file__).with_name("costly.txt")
"""The tests that need more; `python -m tests durations --write` lists them."""

SHORT = "not costly and not slow and not flight and not arrays and not long"
BESIDE = ("-n", "auto", "--dist", "loadfile")
"""How many workers there are is decided in conftest.py."""

GIVES_WAY = 10
"""The niceness of steps that compute beside those in real time."""

PASSED = "passed"
FAILED = "failed"
STARVED = "starved"
CODES = {0: PASSED, 3: STARVED}
"""Verdicts by exit code; 3: every failure of the step was for want of a processor."""


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes:
        what: Description for `--help`.
        command: Command to run.
        marked: Only test files with this mark are collected; collecting all costs each worker some seconds.
        environment: Additional environment variables.
        arguments: Example arguments, if the step accepts arguments when it is run alone.
        nice: Its priority beside steps that must keep real time: 19 is the lowest.
        rows: Tests that have a row of their own in the table, and its name.
    """

    what: str
    command: Sequence[str | Path]
    marked: str = ""
    environment: tuple[tuple[str, str], ...] = ()
    arguments: str = ""
    nice: int = 0
    rows: Mapping[str, str] = field(default_factory=dict)

    @property
    def runs_tests(self) -> bool:
        """Whether it is pytest that runs."""
        return tuple(self.command[: len(PYTEST)]) == PYTEST


@dataclass
class Row:
    """What became of a step.

    Attributes:
        verdict: passed, failed or starved.
        seconds: Wall time; 0 if it passed before.
        processor_s: Processor time of its processes.
        tests: Outcome and processor time of each test, by node id.
    """

    verdict: str
    seconds: float = 0.0
    processor_s: float = 0.0
    tests: dict[str, tuple[str, float]] = field(default_factory=dict)


SENTINELS = {
    "tests/session/test_fly.py::test_the_papers_pe_game_is_flown_within_15_percent_of_its_value": (
        "a flight of PX4"
    ),
    "tests/session/test_fly.py::test_arducopter_flies_the_same_scenario": "a flight of ArduCopter",
    "tests/session/test_fly_several.py::test_two_vehicles_capture_an_evader_each_in_one_world": (
        "a flight of a team"
    ),
    "tests/test_readme.py::test_its_first_command_flies_in_virtual_time": "README's first command",
    "tests/sitl_mock/clients/test_mavsdk_example.py::test_the_mavsdk_example_is_tested_as_its_page_says": (
        "MAVSDK in real time"
    ),
    "tests/sitl_mock/clients/test_mavutil.py::test_mavutil_sets_a_mode_arms_and_disarms[uav1-LOITER]": (
        "pymavlink in real time"
    ),
}
"""One test of every longer proof, and its row in the table."""

TODAY = time.strftime("%Y%m%d")

STEPS = {
    "format": Step("ruff's format", (BIN / "ruff", "format", "--check", ".")),
    "lint": Step("ruff's rules", (BIN / "ruff", "check", ".")),
    "statements": Step(
        "no assignment packs several values", (sys.executable, "-m", "tests.statements")
    ),
    "layers": Step("imports point down only", (BIN / "lint-imports",)),
    "types": Step(
        "mypy: the packages strictly, the tests by the names they use", (BIN / "mypy",), nice=1
    ),
    "tests": Step(
        f"the short tests, each below {SHORT_S:g} s of processor time",
        (*PYTEST, *BESIDE, "-m", SHORT),
        nice=1,
    ),
    "sentinels": Step(
        "one of every longer proof: flights in virtual time, and clients in real time",
        (*PYTEST, *SENTINELS),
        rows=SENTINELS,
    ),
    "ten faults": Step(
        "ten fault flights; the seed is the date",
        (sys.executable, "-m", "tests.faults", "--flights", "10", "--seed", TODAY, "--jobs", "1"),
        nice=1,
    ),
}
"""The steps without arguments."""

FIRST = ("format", "lint", "statements", "layers")
LANES = (("tests",), ("sentinels", "ten faults", "types"))

LONGER = {
    "docs": Step(
        "the documentation as a site, where any warning is an error",
        (BIN / "mkdocs", "build", "--strict", "--config-file", ".mkdocs.yml", "--site-dir", "site"),
        environment=(
            ("NO_MKDOCS_2_WARNING", "1"),
        ),  # suppresses a notice that the theme prints at every start
        nice=GIVES_WAY,
    ),
    "arrays": Step(
        "the games on PyTorch and JAX, in an environment that has both",
        (sys.executable, "-m", "tests.arrays", "--within", "120"),
        nice=GIVES_WAY,
    ),
    "flights": Step(
        "whole flights in virtual time, and other long computations",
        (*PYTEST, *BESIDE, "-m", "(flight or costly) and not slow and not long and not arrays"),
        marked="flight",
        nice=GIVES_WAY,
    ),
    # Tests with real clients mostly wait.
    "real time": Step(
        "other people's clients",
        (
            *PYTEST,
            "-n",
            "6",
            "--dist",
            "loadfile",  # a browser, or a fleet of mocks, is started once a file
            "--no-loadscope-reorder",
            "-m",
            "slow and not long",
        ),
        marked="slow",
    ),
    "acceptance": Step(
        "the service's promises, on a mock over UDP or on running SITLs (docs/acceptance.md)",
        (sys.executable, "-m", "tests.acceptance"),
        arguments="--px4 URL --arducopter URL",
    ),
    "faults": Step(
        "flights with faults, checked against the mock's true state (docs/faults.md)",
        (sys.executable, "-m", "tests.faults", "--jobs", "1"),
        arguments="--flights 1000 --seed 7",
        nice=GIVES_WAY,
    ),
}
"""What `all` runs beside them."""

LANES_OF_ALL = (
    ("tests", "types", "docs", "arrays", "faults"),
    ("flights",),
    ("real time", "acceptance"),
)

ASKED_FOR = {
    "examples": Step(
        "the tests without flights with every example of every property (an eighth otherwise)",
        (*PYTEST, *BESIDE, "-m", "not slow and not flight and not arrays and not long"),
        environment=(("HYPOTHESIS_PROFILE", "all"),),
    ),
    "long": Step(
        "more flights, and longer ones, than every change needs",
        (*PYTEST, *BESIDE, "-m", "long"),
    ),
    "mutants": Step(
        "mutants of the code that keeps people safe, which tests have to notice",
        (sys.executable, "-m", "tests.mutants"),
        arguments="guidance/flight/detection.py",
    ),
    "install": Step(
        "the wheel in an empty environment of every installed Python, and a flight there",
        (sys.executable, "-m", "tests.install"),
    ),
    "coverage": Step(
        "line and branch coverage of the tests in virtual time; takes three times as long",
        (*PYTEST, *BESIDE, "-m", "not slow and not arrays", "--cov", "--cov-report=term"),
    ),
}
"""Steps that run by name only."""

EVERY = STEPS | LONGER | ASKED_FOR
MODULES = {"changed": "tests.changed", "durations": "tests.durations"}
ENVIRONMENT = {
    name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"
}
"""The environment with bytecode caches, because hundreds of processes import the same modules."""


def main(arguments: Sequence[str]) -> int:
    """Run the steps named, or those that every change has to pass."""
    first = arguments[0] if arguments else ""
    if first in MODULES:
        command = (sys.executable, "-m", MODULES[first])
    elif first in EVERY and EVERY[first].arguments:
        command = EVERY[first].command
    else:
        return _run_steps(_parser().parse_args(arguments).steps)
    return subprocess.run([*command, *arguments[1:]], cwd=ROOT, check=False).returncode


def _run_steps(chosen: Sequence[str]) -> int:
    if unknown := [name for name in chosen if name not in {"all", *EVERY}]:
        allowed = ", ".join(["all", *MODULES, *EVERY])
        print(f"unknown step {', '.join(unknown)}: allowed are {allowed}", file=sys.stderr)
        return 2
    if not chosen:
        return run(EVERY, FIRST, LANES)
    if "all" in chosen:
        return run(EVERY, FIRST, LANES_OF_ALL, before=passed_before())
    return run(EVERY, (), [chosen])


def run(
    steps: Mapping[str, Step],
    first: Sequence[str],
    lanes: Sequence[Sequence[str]],
    before: Mapping[str, Row] | None = None,
) -> int:
    """Run steps, print a table of them, and return the exit code.

    Args:
        steps: The steps by name.
        first: Names of steps that run before the others, which do not run if one of these fails.
        lanes: Names of steps; those of a lane run one after another, and the lanes side by side.
        before: Rows of steps that passed on the same files; only their skipped tests run.
    """
    earlier = before or {}
    tree = fingerprint()
    rows = dict(earlier)

    def follow(lane: Sequence[str]) -> dict[str, Row]:
        return {name: _run(steps[name], name, earlier, beside=len(lanes) > 1) for name in lane}

    for one in map(follow, [[name] for name in first]):
        rows |= one
    if all(rows[name].verdict == PASSED for name in first):
        with ThreadPoolExecutor(len(lanes)) as executor:
            for lane in executor.map(follow, lanes):
                rows |= lane
    for name, row in rows.items():
        if row.verdict == STARVED:
            rows[name] = _again(steps[name], name, row)
    rows = {name: rows[name] for name in steps if name in rows}
    if steps is EVERY and first:
        _keep(tree, rows)
    return _conclude(steps, rows)


def _run(step: Step, name: str, earlier: Mapping[str, Row], *, beside: bool) -> Row:
    """Run a step, or what is left of it. If others run at the same time, its output is printed if it fails."""
    command = [str(part) for part in step.command]
    if name in earlier:
        left = [test for test, (outcome, _) in earlier[name].tests.items() if outcome == "skipped"]
        if not left:
            print(f"── {name}: passed before", flush=True)
            return earlier[name]
        command += ["-n", "0", *left]
    else:
        command += _files_with(step.marked) if step.marked else []
        if step.runs_tests:
            passed = [test for row in earlier.values() for test in row.tests if test in SENTINELS]
            command += [f"--deselect={test}" for test in passed]
    shown = [str(part) for part in step.command]
    print(f"── {name}: {' '.join(shown[1:] if shown[0] == sys.executable else shown)}", flush=True)
    if step.runs_tests:
        command += ["--cache-clear", "-o", f"cache_dir={cache_of(name)}"]
    if beside and step.nice and shutil.which("nice"):
        command = ["nice", "-n", str(step.nice), *command]
    row = _done(step, command, name, told=not beside)
    if name in earlier:
        row.tests = earlier[name].tests | row.tests
        row.seconds += earlier[name].seconds
        row.processor_s += earlier[name].processor_s
    print(f"── {name}: {row.verdict} in {row.seconds:.1f} s", flush=True)
    return row


def _done(step: Step, command: Sequence[str], name: str, *, told: bool) -> Row:
    """Run a command to its end and return its row; what it prints is shown at once, or at its end if it fails."""
    started_s = time.perf_counter()
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            command,
            cwd=ROOT,
            env={**ENVIRONMENT, **dict(step.environment)},
            stdout=None if told else said,
            stderr=None if told else subprocess.STDOUT,
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        row = Row(CODES.get(process.returncode, FAILED))
        row.seconds = time.perf_counter() - started_s
        row.processor_s = used.ru_utime + used.ru_stime
        if row.verdict != PASSED:
            said.seek(0)
            print(said.read().decode(errors="replace"), flush=True)
    results = cache_of(name) / "v" / "tests"
    if step.runs_tests and results.is_file():
        row.tests = json.loads(results.read_text(encoding="utf-8"))
    if row.verdict == PASSED and STARVED in outcomes(row):
        row.verdict = STARVED
    return row


def _again(step: Step, name: str, row: Row) -> Row:
    """Run what starved once more, alone."""
    starved = [test for test, (outcome, _) in row.tests.items() if outcome == STARVED]
    print(f"── {name}: starved, runs again alone: {', '.join(starved) or 'all of it'}", flush=True)
    if not starved:
        return _run(step, name, {}, beside=False)
    cache = ("--cache-clear", "-o", f"cache_dir={cache_of(name)}")
    again = _done(step, (*PYTEST, *starved, *cache), name, told=True)
    return Row(
        again.verdict,
        row.seconds + again.seconds,
        row.processor_s + again.processor_s,
        row.tests | again.tests,
    )


def outcomes(row: Row) -> Counter[str]:
    """Return how many of a row's tests had each outcome."""
    return Counter(outcome for outcome, _ in row.tests.values())


def _conclude(steps: Mapping[str, Step], rows: Mapping[str, Row]) -> int:
    """Print the table of all rows and the total; return the exit code."""
    print(f"\n{'':28}{'':10}{'time':>8}{'processor':>12}  tests")
    for name, row in rows.items():
        told = ", ".join(f"{count} {outcome}" for outcome, count in outcomes(row).items())
        print(f"{name:28}{row.verdict:10}{row.seconds:6.1f} s{row.processor_s:10.1f} s  {told}")
        for test, title in steps[name].rows.items():
            outcome, spent_s = row.tests.get(test, ("not run", 0.0))
            print(f"  {title:26}{outcome:10}{'':8}{spent_s:10.1f} s")
    tests = {test: outcome for row in rows.values() for test, (outcome, _) in row.tests.items()}
    others = Counter(row.verdict for row in rows.values() if not row.tests)
    total = Counter(tests.values()) + others
    passed = total[PASSED] + total["xfailed"]
    wrong = total.total() - passed - total["skipped"]
    print(f"\n{total['skipped']} skipped" if total["skipped"] else "")
    print(f"{passed} passed, {wrong} failed", flush=True)
    return int(any(row.verdict != PASSED for row in rows.values()))


def fingerprint() -> str:
    """Return a digest of all files that a step reads, and of the Python that runs it."""
    digest = hashlib.sha256(sys.version.encode())
    for top in ("guidance", "sitl_mock", "config", "tests", "docs", ".ci", ".readme", *TOP):
        for path in sorted((ROOT / top).rglob("*")) or [ROOT / top]:
            if path.is_file() and path.suffix != ".pyc":
                digest.update(
                    path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes()
                )
    return digest.hexdigest()


def _keep(tree: str, rows: Mapping[str, Row]) -> None:
    """Keep the rows that passed, for `python -m tests all`."""
    kept = {name: asdict(row) for name, row in rows.items() if row.verdict == PASSED}
    KEPT.mkdir(exist_ok=True)
    content = {"tree": tree, "rows": kept}
    (KEPT / "passed.json").write_text(json.dumps(content), encoding="utf-8")


def passed_before() -> dict[str, Row]:
    """Return the rows that passed on the same files."""
    try:
        kept = json.loads((KEPT / "passed.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    if kept["tree"] != fingerprint():
        return {}
    return {name: Row(**row) for name, row in kept["rows"].items()}


def cache_of(name: str) -> Path:
    """Return the folder in which a step of pytest keeps its results apart from those of the steps beside it."""
    return KEPT / name.replace(" ", "_")


def _files_with(mark: str) -> list[str]:
    """Return the files of tests with a mark; the browser's first, because they take longest."""
    listed = {test.partition("::")[0] for test in costly()} if mark == "flight" else set()
    files = sorted((ROOT / "tests").rglob("test_*.py"), reverse=True)
    return [
        name
        for file in files
        if (name := file.relative_to(ROOT).as_posix()) in listed
        or f"mark.{mark}" in file.read_text(encoding="utf-8")
    ]


def costly() -> dict[str, float]:
    """Return the processor time of the tests that are listed as costly, by node id."""
    rows = (line.split(maxsplit=1) for line in COSTLY.read_text(encoding="utf-8").splitlines())
    return {test: float(spent_s) for spent_s, test in rows}


def _parser() -> argparse.ArgumentParser:
    described = {
        "without arguments": STEPS,
        "in `all` beside them": LONGER,
        "by name only": ASKED_FOR,
    }
    epilog = "".join(
        f"{title}:\n" + "".join(f"  {name:12}{step.what}\n" for name, step in steps.items()) + "\n"
        for title, steps in described.items()
    )
    told = "\n".join(
        f"  python -m tests {name} {step.arguments}"
        for name, step in EVERY.items()
        if step.arguments
    )
    parser = argparse.ArgumentParser(
        prog="python -m tests",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=f"{epilog}with arguments of their own, for example:\n{told}",
    )
    parser.add_argument("steps", nargs="*", metavar="STEP", help="`all`, or names of steps")
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
