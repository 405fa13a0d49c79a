"""Workers share the files of tests, and one that ends before its tests do is an error."""

import os
import subprocess
import sys

ONE = """
import os

def test_a():
    print("said", os.getpid())
    os.environ["LEFT"] = "by a"

def test_b():
    assert os.environ["LEFT"] == "by a", "a file runs in one process"
    raise AssertionError("of " + __name__)
"""
ENDS = """
import os

def test_that_ends_the_process():
    os._exit(7)
"""


def run(folder, **files):
    for name, text in files.items():
        (folder / f"test_{name}.py").write_text(text)
    (folder / "pytest.ini").write_text("[pytest]\n")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.harness.workers"]
    return subprocess.run(
        [*command, "--workers", "2", "-p", "no:cacheprovider", "--rootdir", folder, folder],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        timeout=60.0,
    )


def test_each_file_runs_in_one_worker_and_its_reports_and_output_are_shown(tmp_path):
    done = run(tmp_path, one=ONE, two=ONE, three=ONE)
    assert done.returncode == 1
    assert "3 failed, 3 passed" in done.stdout
    for name in ("one", "two", "three"):
        assert f"AssertionError: of test_{name}" in done.stdout
    assert "said" not in done.stdout  # what a test prints that passes


def test_a_worker_that_ends_in_a_test_is_an_error_that_names_the_test(tmp_path):
    done = run(tmp_path, one=ENDS, two=ONE)
    assert done.returncode == 2
    assert "a worker ended with code 7 in test_one.py::test_that_ends_the_process" in done.stdout
