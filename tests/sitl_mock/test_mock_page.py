"""Every example on the page about the mock runs."""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from pymavlink import mavutil

from sitl_mock import Home
from sitl_mock.serving.fleet import FleetConfig, SigningConfig, VehicleConfig, build, checked_fleet
from tests.harness.ports import mock_ports
from tests.witness import page

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "mock.md").read_text(encoding="utf-8")
PATH = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


@pytest.fixture
def run():
    children = []

    def run(arguments):
        child = subprocess.Popen(
            [sys.executable, "-m", "sitl_mock", *arguments, "--parent-pipe"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        children.append(child)
        return child

    yield run
    for child in children:
        child.stdin.close()
        child.wait(5.0)
        child.stdout.close()


def test_the_first_command_prints_what_is_shown(run):
    """Catches a page that shows another output than the command's."""
    port = mock_ports()
    command = blocks("sh")[0]
    shown = blocks("text")[0]
    program, *arguments = shlex.split(command.replace("14540", str(port)))
    assert program == "sitl-mock"
    child = run(arguments)
    expected = shown.replace("14550", str(port + 10)).replace("14540", str(port)).splitlines()
    assert [child.stdout.readline().rstrip("\n") for _ in expected] == expected


def test_the_fleet_file_has_every_key_and_flies():
    values = tomllib.loads(blocks("toml")[0])
    assert set(values) == {*FleetConfig.__dataclass_fields__}
    assert set(values["home"]) == {*Home._fields}
    assert set(values["vehicle"][0]) == {*VehicleConfig.__dataclass_fields__}
    assert set(values["vehicle"][0]["signing"]) == {*SigningConfig.__dataclass_fields__}
    vehicles = build(checked_fleet(values, "the page"))
    assert [vehicle.flavour for vehicle in vehicles.values()] == ["px4", "rover"]
    assert vehicles["uav1"].autopilot.parameters["MPC_XY_VEL_MAX"] == 8.0


def test_the_suite_of_the_recipe_passes_with_the_plugin_alone(tmp_path):
    """Catches a recipe of the page that fails, or needs our own tests."""
    (tmp_path / "test_recipe.py").write_text("\n\n".join(blocks("python")), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_recipe.py"],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120.0,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert "6 passed" in done.stdout


def test_the_workflow_installs_this_project_and_its_client_flies(tmp_path):
    """Catches a workflow of the page that no longer runs."""
    (job,) = yaml.safe_load(blocks("yaml")[0])["jobs"].values()
    steps = {step.get("name", step.get("uses")): step for step in job["steps"]}
    checkout = steps["actions/checkout@v4"]["with"]["path"]
    _, _, package, runner = steps["Install the mock and the suite's runner"]["run"].split()
    assert runner == "pytest"
    project = ROOT / Path(package).relative_to(checkout) / "pyproject.toml"
    assert (
        tomllib.loads(project.read_text(encoding="utf-8"))["project"]["name"] == "pursuit-sitl-mock"
    )
    port = str(mock_ports())
    client = tmp_path / "client"
    client.write_text(
        f"#!{sys.executable}\n"
        "import sys\n"
        "from pymavlink import mavutil\n"
        'client = mavutil.mavlink_connection(sys.argv[1].replace("//", ""))\n'
        "assert client.wait_heartbeat(timeout=5.0).autopilot == 12\n"
        'open("heard", "w").close()\n',
        encoding="utf-8",
    )
    client.chmod(0o755)
    (tmp_path / "sitl-mock").write_text(
        f'#!/bin/sh\nexec {sys.executable} -m sitl_mock "$@"\n', encoding="utf-8"
    )
    (tmp_path / "sitl-mock").chmod(0o755)
    script = steps["A client of another language"]["run"].replace("14540", port)
    subprocess.run(
        ["bash", "-e", "-c", script], cwd=tmp_path, check=True, timeout=60.0,
        env={**os.environ, "PATH": f"{tmp_path}{os.pathsep}{PATH}", "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert (tmp_path / "heard").exists()
    assert json.loads((tmp_path / "mock.json").read_text(encoding="utf-8"))["event"] == "ready"


def test_a_ground_station_that_only_listens_sees_every_vehicle_and_reads_parameters(run):
    """Catches a port for ground stations that a listener never hears."""
    port = mock_ports()
    program, *arguments = shlex.split(
        next(block for block in blocks("sh") if "--gcs" in block).replace("14550", str(port))
    )
    assert program == "sitl-mock"
    station = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=255)
    run(arguments)
    seen = set()
    while seen != {1, 2}:
        seen.add(station.recv_match(type="HEARTBEAT", blocking=True, timeout=10.0).get_srcSystem())
    station.mav.param_request_read_send(1, 1, b"MPC_XY_VEL_MAX", -1)
    station.mav.param_request_read_send(2, 1, b"CRUISE_SPEED", -1)
    read = set()
    while read != {"MPC_XY_VEL_MAX", "CRUISE_SPEED"}:
        read.add(station.recv_match(type="PARAM_VALUE", blocking=True, timeout=10.0).param_id)
    station.close()


def test_the_tables_say_what_was_seen_of_the_autopilots_and_their_mocks_and_name_every_cause():
    for autopilot, cells in page.read().items():
        assert page.judged(autopilot, cells) == []
        causes = page.causes_of(autopilot)
        for title, cell in cells.items():
            assert page.row(title, cell, causes.get(title, "")) in PAGE
