"""Child processes import nothing from the current folder."""

import subprocess

import pytest

from guidance.cli.viewers import command
from sitl_mock.child import running

MODULES = ("tomllib", "numpy", "typer", "zenoh", "rich", "json")


@pytest.fixture
def hostile_folder(tmp_path, monkeypatch):
    """The current folder, with modules of common names that leave a trace when they are imported."""
    for name in MODULES:
        (tmp_path / f"{name}.py").write_text(
            f"open({str(tmp_path / 'imported')!r}, 'a').write('{name} ')\n"
        )
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("arguments", [("panel", "--help"), ("view", "--help")])
def test_commands_beside_a_flight_import_nothing_from_the_folder(hostile_folder, arguments):
    """Catches a file of the working folder that is imported in place of a module."""
    with subprocess.Popen(
        command(arguments), stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        assert b"Usage" in child.stdout.read()
    assert not (hostile_folder / "imported").exists()


def test_the_mock_imports_nothing_from_the_folder(hostile_folder):
    """Catches a file of the working folder that the mock imports in place of a module."""
    with running([{"name": "uav1", "flavour": "px4"}], over=("udp",)):
        pass
    assert not (hostile_folder / "imported").exists()
