"""A flight whose files cannot be written whole ends with 5 and leaves no file that looks whole."""

import resource
import subprocess
import sys
from pathlib import Path

import pytest

from guidance.errors import OutputError
from guidance.log import survey_of

NEAR = Path(__file__).parent.parent / "data" / "near_chase.toml"


def limit_file_size():
    """Let no file of the child grow beyond 40 kB; the kernel then refuses writes as on a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))


@pytest.mark.flight
def test_a_full_disk_ends_with_its_code_and_without_empty_files(tmp_path):
    out = tmp_path / "flight"
    command = [sys.executable, "-m", "guidance", "fly", NEAR, "--fast", "--out", out]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        preexec_fn=limit_file_size,
        timeout=120,
        check=False,
    )
    assert done.returncode == OutputError.exit_code, done.stderr
    assert "not recorded whole" in done.stderr
    assert survey_of(out / "record.mcap").faults
    assert all(file.stat().st_size > 0 for file in out.iterdir())
    assert not (out / "flight.png").exists()
