"""A real-time test that fails while it has no processor is starved; any other failure is one."""

import json
import os
import subprocess
import sys
import time

from tests.harness.starved import STARVED_S, Waiting

SPIN = "import time\nwhile time.monotonic() < {until}: pass"
FAILING = """
import time
import pytest
from tests.harness import starved

def test_starved(monkeypatch):
    monkeypatch.setattr(starved.Waiting, "starved", lambda _: "a thread waited 9 s")
    raise AssertionError("for want of a processor")

def test_wrong():
    raise AssertionError("for a defect")

def test_right():
    pass
"""


def test_threads_that_share_a_processor_are_seen_to_wait():
    """Catches a wait for a processor that the measurement does not see."""
    cores = os.sched_getaffinity(0)
    spin = [sys.executable, "-c", SPIN.format(until=time.monotonic() + 1.5)]
    try:
        os.sched_setaffinity(0, {min(cores)})  # its children stay there too
        children = [subprocess.Popen(spin) for _ in range(3)]
    finally:
        os.sched_setaffinity(0, cores)
    with Waiting() as waiting:
        for child in children:
            child.wait()
    assert waiting.longest_s > STARVED_S
    assert "for a processor" in waiting.starved()


def test_a_failure_for_want_of_a_processor_is_counted_as_starved(tmp_path):
    """Catches a starved test that counts as failed, or a failed one that counts as starved.

    The conftest of these tests, in a folder of its own.
    """
    (tmp_path / "conftest.py").write_text("from tests.conftest import *\n")
    (tmp_path / "test_three.py").write_text(FAILING)
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-n",
        "1",
        "--rootdir",
        str(tmp_path),
        str(tmp_path),
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=tmp_path, env=here()
    )
    assert done.returncode == 1
    assert "1 failed, 1 passed, 1 starved" in done.stdout
    assert "for want of a processor" in done.stdout
    assert "FAILED test_three.py::test_wrong" in done.stdout
    kept = json.loads((tmp_path / ".pytest_cache/v/tests").read_text())
    assert {test.partition("::")[2]: outcome for test, (outcome, _) in kept.items()} == {
        "test_starved": "starved",  # `python -m tests` runs it again
        "test_wrong": "failed",
        "test_right": "passed",
    }
    assert all(0.0 < spent_s < 1.0 for _, spent_s in kept.values())


def here():
    return {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
