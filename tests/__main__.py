"""`python -m tests`: everything that must hold before a change lands. Stops at the first step that fails.

`python -m tests coverage` measures what the quick tests reach, by line and branch, in three times the time.
`python -m tests acceptance --px4 URL --arducopter URL` flies on SITLs that run (docs/acceptance.md);
without a URL, as here, each kind of flight is flown on a mock over UDP.
"""

import subprocess
import sys
import time
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
    "real time": [*PYTEST, "-n", "3", "-m", "slow"],
    "acceptance": [sys.executable, "-m", "tests.acceptance"],
}

ASKED_FOR = {
    "coverage": [*PYTEST, "-n", "2", "-m", "not slow", "--cov", "--cov-report=term"],
}
"""Steps that run by name only."""


def main() -> int:
    if sys.argv[1:2] == ["acceptance"]:
        return subprocess.run([*STEPS["acceptance"], *sys.argv[2:]], cwd=ROOT, check=False).returncode
    chosen = sys.argv[1:] or list(STEPS)
    steps = STEPS | ASKED_FOR
    unknown = set(chosen) - set(steps)
    if unknown:
        print(f"unknown step {', '.join(sorted(unknown))}: allowed are {', '.join(steps)}", file=sys.stderr)
        return 2
    for name in chosen:
        command = [str(part) for part in steps[name]]
        print(f"── {name}: {' '.join(command[1:] if command[0] == sys.executable else command)}", flush=True)
        started = time.perf_counter()
        code = subprocess.run(command, cwd=ROOT, check=False).returncode
        print(
            f"── {name}: {'ok' if code == 0 else f'failed ({code})'} in {time.perf_counter() - started:.1f} s",
            flush=True,
        )
        if code:
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
