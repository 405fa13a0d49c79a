"""`python -m tests`: everything that must hold before a change lands. Stops at the first step that fails.

`python -m tests coverage` measures what the quick tests reach, by line and branch, in three times the time.
`python -m tests acceptance --px4 URL --arducopter URL` flies on SITLs that run (docs/acceptance.md);
without a URL, as here, each kind of flight is flown on a mock over UDP.
`python -m tests install` installs the wheel into an empty environment of every Python that it finds, and flies there.
`python -m tests faults --flights 1000 --seed 7` flies more of the flights in which things go wrong (docs/faults.md).
"""

import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parent.parent
BIN = Path(sys.executable).parent

PYTEST = [sys.executable, "-m", "pytest", "-q", "--dist", "loadfile", "--durations", "12"]

STEPS = {
    "format": [BIN / "ruff", "format", "--check", "."],
    "lint": [BIN / "ruff", "check", "."],
    "types": [BIN / "mypy"],
    "layers": [BIN / "lint-imports"],
    "tests": [*PYTEST, "-n", "2", "-m", "not slow"],
    # Real clients in real time wait more than they work.
    "real time": [*PYTEST, "-n", "3", "--dist", "load", "-m", "slow"],
    "acceptance": [sys.executable, "-m", "tests.acceptance"],
}

TOGETHER = (("format",), ("lint",), ("types", "layers"), ("tests",), ("real time", "acceptance"))
"""Which steps run at the same time: those that wait more than they work, and those of one processor."""

ASKED_FOR = {
    "install": [sys.executable, "-m", "tests.install"],
    "coverage": [*PYTEST, "-n", "2", "-m", "not slow", "--cov", "--cov-report=term"],
    "faults": [sys.executable, "-m", "tests.faults"],
}
"""Steps that run by name only."""


def main() -> int:
    if sys.argv[1:2] in (["acceptance"], ["faults"]):
        return subprocess.run([*(STEPS | ASKED_FOR)[sys.argv[1]], *sys.argv[2:]], cwd=ROOT, check=False).returncode
    chosen = sys.argv[1:] or list(STEPS)
    steps = STEPS | ASKED_FOR
    unknown = set(chosen) - set(steps)
    if unknown:
        print(f"unknown step {', '.join(sorted(unknown))}: allowed are {', '.join(steps)}", file=sys.stderr)
        return 2
    groups = [group for group in (tuple(name for name in named if name in chosen) for named in TOGETHER) if group]
    for group in (*groups, *((name,) for name in chosen if name in ASKED_FOR)):
        with ThreadPoolExecutor(len(group)) as executor:
            codes = list(executor.map(_run, group, [len(group) > 1] * len(group)))
        if any(codes):
            return next(code for code in codes if code)
    return 0


def _run(name: str, beside_another: bool) -> int:
    """Run one step; what it prints comes at its end where another one runs beside it."""
    command = [str(part) for part in (STEPS | ASKED_FOR)[name]]
    shown = " ".join(command[1:] if command[0] == sys.executable else command)
    print(f"── {name}: {shown}", flush=True)
    started = time.perf_counter()
    done = subprocess.run(
        command,
        cwd=ROOT,
        check=False,
        stdout=subprocess.PIPE if beside_another else None,
        stderr=subprocess.STDOUT if beside_another else None,
    )
    passed_s = time.perf_counter() - started
    verdict = "ok" if done.returncode == 0 else f"failed ({done.returncode})"
    print((done.stdout or b"").decode(errors="replace") + f"── {name}: {verdict} in {passed_s:.1f} s", flush=True)
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
