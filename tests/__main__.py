"""Runs all checks that a change must pass, or the named ones.

Format, lint and layers come first. Then three lanes run side by side, each one step after another; a lane ends at its
first failure. Two lanes compute, at a low priority. The third keeps real time and mostly waits.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
BIN = Path(sys.executable).parent
PYTEST = (sys.executable, "-m", "pytest", "-q", "--durations", "12")
QUICK = "not slow and not flight and not arrays and not long"


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes:
        what: Description for `--help`.
        command: Command to run.
        marked: Only test files with this mark are collected; collecting all costs each worker some seconds.
        environment: Additional environment variables.
        arguments: Example arguments, if the step accepts arguments when it is run alone.
        nice: Its priority beside other steps, which must keep real time: 19 is the lowest.
        after: A step of another lane that has to end before, if it runs at all.
        told: Whether its output is printed although it passed.
    """

    what: str
    command: Sequence[str | Path]
    marked: str = ""
    environment: tuple[tuple[str, str], ...] = ()
    arguments: str = ""
    nice: int = 0
    after: str = ""
    told: bool = True


STEPS = {
    "format": Step("ruff's format", (BIN / "ruff", "format", "--check", ".")),
    "lint": Step("ruff's rules", (BIN / "ruff", "check", ".")),
    "statements": Step(
        "no assignment packs several values", (sys.executable, "-m", "tests.statements")
    ),
    "types": Step(
        "mypy: the packages strictly, the tests by the names they use", (BIN / "mypy",), nice=2
    ),
    "layers": Step("imports point down only", (BIN / "lint-imports",)),
    "docs": Step(
        "the documentation as a site, where any warning is an error",
        (BIN / "mkdocs", "build", "--strict", "--config-file", ".mkdocs.yml", "--site-dir", "site"),
        environment=(
            ("NO_MKDOCS_2_WARNING", "1"),
        ),  # suppresses a notice that the theme prints at every start
        nice=2,
    ),
    "arrays": Step(
        "the games on PyTorch and JAX, in an environment that has both",
        (sys.executable, "-m", "tests.arrays", "--within", "120"),
        nice=2,
    ),
    # In a new environment one process compiles the modules and the tests; eight at a time would each compile them.
    "collected": Step(
        "every test is found, and every module compiled once",
        (sys.executable, "-m", "pytest", "-qq", "--collect-only"),
        nice=2,
        told=False,
    ),
    # Some wait for sockets and processes, but each has seconds.
    "tests": Step(
        "the quick tests", (*PYTEST, "-n", "2", "--dist", "loadfile", "-m", QUICK), nice=5
    ),
    "flights": Step(
        "whole flights in virtual time, and other long computations",
        (*PYTEST, "-n", "2", "--dist", "loadfile", "-m", "flight and not slow and not long"),
        marked="flight",
        nice=10,
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
        after="collected",
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
        nice=2,
    ),
}
FIRST = ("format", "lint", "statements", "layers")
LANES = (
    ("collected", "tests"),
    ("types", "docs", "arrays", "faults", "flights"),
    ("real time", "acceptance"),
)
"""The steps of a lane run one after another; the lanes run at the same time, once the first steps have passed."""

_ENVIRONMENT = {
    name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"
}
"""The environment with bytecode caches, because hundreds of processes import the same modules."""

ASKED_FOR = {
    "examples": Step(
        "the quick tests with every example of every property (an eighth otherwise)",
        (*PYTEST, "-n", "2", "--dist", "loadfile", "-m", QUICK),
        environment=(("HYPOTHESIS_PROFILE", "all"),),
    ),
    "long": Step(
        "more flights, and longer ones, than every change needs",
        (*PYTEST, "-n", "2", "--dist", "loadfile", "-m", "long"),
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
        (
            *PYTEST,
            "-n",
            "2",
            "--dist",
            "loadfile",
            "-m",
            "not slow and not arrays",
            "--cov",
            "--cov-report=term",
        ),
    ),
}
"""Steps that run by name only."""


def main(arguments: Sequence[str]) -> int:
    """Run the steps named, or all."""
    steps = STEPS | ASKED_FOR
    if arguments and steps.get(arguments[0], STEPS["tests"]).arguments:
        command = [*steps[arguments[0]].command, *arguments[1:]]
        return subprocess.run(command, cwd=ROOT, check=False).returncode
    chosen = _parser().parse_args(arguments).steps or list(STEPS)
    if unknown := [name for name in chosen if name not in steps]:
        print(f"unknown step {', '.join(unknown)}: allowed are {', '.join(steps)}", file=sys.stderr)
        return 2
    if code := _one_by_one([name for name in FIRST if name in chosen], alone=True):
        return code
    lanes = [names for lane in LANES if (names := [name for name in lane if name in chosen])]
    ended = {name: threading.Event() for lane in lanes for name in lane}
    with ThreadPoolExecutor(len(LANES)) as executor:
        codes = list(executor.map(lambda names: _lane(names, ended), lanes))
    codes.append(_again([name for lane in lanes for name in lane]))
    return next(filter(None, codes), 0) or _one_by_one(
        [name for name in chosen if name in ASKED_FOR], alone=True
    )


def _lane(names: Sequence[str], ended: Mapping[str, threading.Event]) -> int:
    """Run the steps of a lane until one fails, each after the one that it waits for; return its exit code, or 0."""
    code = 0
    for name in names:
        if STEPS[name].after in ended:
            ended[STEPS[name].after].wait()
        try:
            code = code or _run(name, beside_another=len(ended) > len(names))
        finally:
            ended[name].set()
    return code


def _one_by_one(names: Sequence[str], *, alone: bool) -> int:
    """Run steps until one fails; return its exit code, or 0."""
    return next(filter(None, (_run(name, beside_another=not alone) for name in names)), 0)


def _parser() -> argparse.ArgumentParser:
    listed, more = (
        "\n".join(f"  {name:12}{step.what}" for name, step in steps.items())
        for steps in (STEPS, ASKED_FOR)
    )
    told = "\n".join(
        f"  python -m tests {name} {step.arguments}"
        for name, step in (STEPS | ASKED_FOR).items()
        if step.arguments
    )
    parser = argparse.ArgumentParser(
        prog="python -m tests",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=f"steps:\n{listed}\n\nby name only:\n{more}\n\nwith arguments of their own, for example:\n{told}",
    )
    parser.add_argument("steps", nargs="*", metavar="step", help="all in order if none is named")
    return parser


def _run(name: str, *, beside_another: bool) -> int:
    """Run one step. If other steps run at the same time, its output is printed at its end."""
    step = (STEPS | ASKED_FOR)[name]
    command = [str(part) for part in step.command]
    shown = " ".join(command[1:] if command[0] == sys.executable else command)
    print(f"── {name}: {shown}", flush=True)
    if command[: len(PYTEST)] == [*PYTEST]:
        command += ["--cache-clear", "-o", f"cache_dir={_cache(name)}"]
    if step.marked:
        command += _files_with(step.marked)
    if beside_another and step.nice and shutil.which("nice"):
        command = ["nice", "-n", str(step.nice), *command]
    started = time.perf_counter()
    done = subprocess.run(
        command,
        cwd=ROOT,
        check=False,
        env={**_ENVIRONMENT, **dict(step.environment)},
        stdout=subprocess.PIPE if beside_another else None,
        stderr=subprocess.STDOUT if beside_another else None,
    )
    passed_s = time.perf_counter() - started
    verdict = "ok" if done.returncode == 0 else f"failed ({done.returncode})"
    said = done.stdout or b"" if step.told or done.returncode else b""
    print(
        said.decode(errors="replace") + f"── {name}: {verdict} in {passed_s:.1f} s",
        flush=True,
    )
    return done.returncode


def _cache(name: str) -> str:
    """Return the folder in which a step of pytest keeps its results apart from those of the steps beside it."""
    return f".pytest_cache/{name.replace(' ', '_')}"


def _again(names: Sequence[str]) -> int:
    """Run the inconclusive tests of these steps once more; what stays inconclusive is counted and is no failure."""
    listed = [ROOT / _cache(name) / "v/inconclusive" for name in names]
    found = [
        test
        for path in listed
        if path.is_file()
        for test in json.loads(path.read_text(encoding="utf-8"))
    ]
    if not found:
        return 0
    print(f"── inconclusive, run again alone: {', '.join(found)}", flush=True)
    return subprocess.run(
        [*map(str, PYTEST), *found], cwd=ROOT, check=False, env=_ENVIRONMENT
    ).returncode


def _files_with(mark: str) -> list[str]:
    """Return the files of tests with a mark; the browser's first, because they take longest."""
    files = sorted((ROOT / "tests").rglob("test_*.py"), reverse=True)
    return [
        str(file.relative_to(ROOT))
        for file in files
        if f"mark.{mark}" in file.read_text(encoding="utf-8")
    ]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
