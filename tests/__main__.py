"""Everything that must hold before a change lands: all steps in order, or those named. Ends at the first that fails."""

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
BIN = Path(sys.executable).parent
PYTEST = (sys.executable, "-m", "pytest", "-q", "--durations", "12")
QUICK = "not slow and not flight and not arrays"
FAILED_IN = ".pytest_cache/real_time"
TESTS_FAILED = 1
"""What pytest ends with where tests were run, and some failed."""


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes:
        what: It shows, for `--help`.
        command: It runs.
        marked: Only test files with tests of this mark are read: to collect all costs each worker some seconds.
        environment: More of it.
        arguments: It takes, said to it alone.
        gives_way: To whatever runs beside it: it works without a pause, and they are held to real time.
        again: Of how many that fail each is given a second chance, by itself, when all that ran beside the step has
            ended: processors that were too busy for a flight in real time say nothing about the flight.
    """

    what: str
    command: Sequence[str | Path]
    marked: str = ""
    environment: tuple[tuple[str, str], ...] = ()
    arguments: str = ""
    gives_way: bool = False
    again: int = 0


STEPS = {
    "format": Step("ruff's format", (BIN / "ruff", "format", "--check", ".")),
    "lint": Step("ruff's rules", (BIN / "ruff", "check", ".")),
    "types": Step("mypy: the packages strictly, the tests by the names they use", (BIN / "mypy",)),
    "layers": Step("imports point down only", (BIN / "lint-imports",)),
    "docs": Step(
        "the documentation as a site, where any warning is an error",
        (BIN / "mkdocs", "build", "--strict", "--config-file", ".mkdocs.yml", "--site-dir", "site"),
        environment=(("NO_MKDOCS_2_WARNING", "1"),),  # its theme says at every start where it is headed
    ),
    "arrays": Step(
        "the games on PyTorch and JAX, in an environment that has both",
        (sys.executable, "-m", "tests.arrays", "--within", "120"),
        gives_way=True,
    ),
    # Each worker would compile every file of tests for itself, at the same time as the others.
    "collect": Step("that every file of tests can be read", (*PYTEST[:3], "-qq", "--collect-only"), gives_way=True),
    # Some of it waits for sockets and processes: a third worker has the processors meanwhile.
    "tests": Step("all that is quick", (*PYTEST, "-n", "3", "--dist", "loadfile", "-m", QUICK)),
    "flights": Step(
        "whole flights in virtual time, and what works as long without a pause",
        (*PYTEST, "-n", "1", "--dist", "loadfile", "-m", "flight and not slow and not long"),
        marked="flight",
        gives_way=True,
    ),
    # Real clients wait more than they work.
    "real time": Step(
        "other people's clients",
        (*PYTEST, "-n", "3", "--dist", "worksteal", "-m", "slow", "--cache-clear", "-o", f"cache_dir={FAILED_IN}"),
        marked="slow",
        again=3,
    ),
    "acceptance": Step(
        "what is promised, on a mock over UDP, or on SITLs that run (docs/acceptance.md)",
        (sys.executable, "-m", "tests.acceptance"),
        arguments="--px4 URL --arducopter URL",
    ),
    "faults": Step(
        "flights in which things go wrong, held against the mock's truth (docs/faults.md)",
        (sys.executable, "-m", "tests.faults", "--jobs", "1"),
        arguments="--flights 1000 --seed 7",
        gives_way=True,
    ),
}
TOGETHER = (
    ("format", "lint"),
    ("types", "layers", "docs", "faults", "arrays", "collect"),
    ("tests",),
    ("flights", "real time", "acceptance"),
)
"""Which steps run at the same time."""

_ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""Hundreds of processes import the same modules: they are compiled once."""

ASKED_FOR = {
    "examples": Step(
        "the quick tests with every example of every property (a quarter otherwise)",
        (*PYTEST, "-n", "2", "--dist", "loadfile", "-m", QUICK),
        environment=(("HYPOTHESIS_PROFILE", "all"),),
    ),
    "long": Step("flights of minutes in virtual time, too long for every change", (*PYTEST, "-m", "long")),
    "install": Step(
        "the wheel in an empty environment of every Python that is found, and a flight there",
        (sys.executable, "-m", "tests.install"),
    ),
    "coverage": Step(
        "what the tests in virtual time reach, by line and branch, in three times the time",
        (*PYTEST, "-n", "2", "--dist", "loadfile", "-m", "not slow and not arrays", "--cov", "--cov-report=term"),
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
    groups = [tuple(name for name in named if name in chosen) for named in TOGETHER]
    for group in (*filter(None, groups), *((name,) for name in chosen if name in ASKED_FOR)):
        with ThreadPoolExecutor(len(group)) as executor:
            codes = list(executor.map(_run, group, [len(group) > 1] * len(group)))
        codes = [
            _by_themselves(name) if code == TESTS_FAILED else code for name, code in zip(group, codes, strict=True)
        ]
        if any(codes):
            return next(code for code in codes if code)
    return 0


def _parser() -> argparse.ArgumentParser:
    listed, more = (
        "\n".join(f"  {name:12}{step.what}" for name, step in steps.items()) for steps in (STEPS, ASKED_FOR)
    )
    told = "\n".join(
        f"  python -m tests {name} {step.arguments}" for name, step in (STEPS | ASKED_FOR).items() if step.arguments
    )
    parser = argparse.ArgumentParser(
        prog="python -m tests",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=f"steps:\n{listed}\n\nby name only:\n{more}\n\nwith arguments of their own, for example:\n{told}",
    )
    parser.add_argument("steps", nargs="*", metavar="step", help="all in order if none is named")
    return parser


def _run(name: str, beside_another: bool) -> int:
    """Run one step; what it prints comes at its end where another one runs beside it."""
    step = (STEPS | ASKED_FOR)[name]
    command = [str(part) for part in step.command]
    shown = " ".join(command[1:] if command[0] == sys.executable else command)
    print(f"── {name}: {shown}", flush=True)
    if step.marked:
        command += _files_with(step.marked)
    if beside_another and step.gives_way and shutil.which("nice"):
        command = ["nice", "-n", "19", *command]
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
    print((done.stdout or b"").decode(errors="replace") + f"── {name}: {verdict} in {passed_s:.1f} s", flush=True)
    return done.returncode


def _by_themselves(name: str) -> int:
    """Run the tests of a step that failed once more, one after another, if it has tests for which that says more."""
    most, listed = (STEPS | ASKED_FOR)[name].again, ROOT / FAILED_IN / "v/cache/lastfailed"
    failed = json.loads(listed.read_text(encoding="utf-8")) if most and listed.is_file() else ()
    if not 0 < len(failed) <= most:
        return TESTS_FAILED
    print(f"── {name}: by themselves once more: {', '.join(failed)}", flush=True)
    return subprocess.run([*map(str, PYTEST), *failed], cwd=ROOT, check=False, env=_ENVIRONMENT).returncode


def _files_with(mark: str) -> list[str]:
    files = sorted((ROOT / "tests").rglob("test_*.py"))
    return [str(file.relative_to(ROOT)) for file in files if f"mark.{mark}" in file.read_text(encoding="utf-8")]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
