"""A newcomer's installation: small, whole by itself, and clear about what it leaves out."""

import itertools
import subprocess
import sys
import zipfile

import pytest

from guidance.errors import ConfigError
from guidance.extras import EXTRAS, require_extras
from tests.install import (
    LARGEST_MB,
    LARGEST_MOCK_MB,
    MOCK,
    MOCK_PROJECT,
    OF_EXTRAS,
    PROJECT,
    ROOT,
    Installed,
    first_heartbeat_s,
    trimming,
    wheel,
)


def without_extras(*commands, folder):
    """Run guidance commands, one after another, as if no package of an extra were installed; print their codes."""
    code = f"""
import importlib.util, sys
class Absent:
    def find_spec(self, name, *_):
        if name.partition(".")[0] in {OF_EXTRAS!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, package=None: None if name in {OF_EXTRAS!r} else found(name, package)
sys.meta_path.insert(0, Absent())
from guidance.cli import main
codes = []
for command in {commands!r}:
    sys.argv = ["guidance", *command]
    try:
        main()
    except SystemExit as ended:
        codes.append(ended.code)
print(*codes)
"""
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_games_and_records_need_no_extra_and_teams_name_theirs(tmp_path):
    """Catches an import that needs an extra where none is promised, and a missing one that ends in a traceback."""
    record = str(ROOT / "tests" / "data" / "short_chase.mcap")
    done = without_extras(
        ("scenario", "run", "pe", "--as", "maths"),
        ("log", "info", record),
        ("log", "export", record, "flight.tlog"),
        ("scenario", "run", "teams_tad"),
        folder=tmp_path,
    )
    assert done.stdout.splitlines()[-1] == "0 0 0 2", done.stderr
    assert (
        "match_teams: needs pyarrow, scipy, which are not installed: pip install 'pursuit-guidance[sim]'"
        in done.stderr
    )


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (("sweep", "policies"), "sim"),
        (("sweep", "report", "."), "sim,plot"),
        (("compare", "a", "b"), "sim"),
        (("report", "record.mcap"), "plot"),
        (("paper",), "plot"),
        (("view", "record.mcap"), "viz"),
        (("panel",), "panel"),
        (("scenario", "show", "pe", "--out", "pe.png"), "plot"),
    ],
)
def test_a_command_whose_extra_is_missing_says_which_and_how_to_add_it(
    arguments, extra, tmp_path, monkeypatch
):
    from guidance.cli.program import app

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("guidance.extras.find_spec", lambda _: None)
    with pytest.raises(
        ConfigError, match=rf"not installed: pip install 'pursuit-guidance\[{extra}\]'"
    ):
        app(list(arguments), standalone_mode=False)


def test_every_extra_that_a_message_names_is_declared_and_brings_what_is_missed():
    extras = PROJECT["optional-dependencies"]
    named = {"rerun": "rerun-sdk"}
    for extra, packages in EXTRAS.items():
        brought = " ".join(extras[extra])
        assert [name for name in packages if named.get(name, name) not in brought] == []
    assert {"sim", "plot", "viz", "torch", "jax", "all", "dev"} <= set(extras)
    require_extras("here everything is", *EXTRAS)


def test_a_container_leaves_out_what_the_page_about_small_computers_does():
    made_of = (ROOT / "docs" / "how-to" / "Containerfile").read_text(encoding="utf-8").splitlines()
    assert len(trimming()) == 2
    assert [line for line in trimming() if f"RUN {line}" not in made_of] == []


@pytest.fixture(scope="module")
def mock_wheel(tmp_path_factory):
    """The wheel that the mock's own folder makes."""
    return wheel(tmp_path_factory.mktemp("mock"), MOCK)


@pytest.fixture(scope="module")
def project_wheel(tmp_path_factory):
    """The wheel of the whole project."""
    return wheel(tmp_path_factory.mktemp("project"))


def files_of_mock(built):
    """Return the files of `sitl_mock` in a wheel, by name."""
    with zipfile.ZipFile(built) as files:
        return {
            name: files.read(name) for name in files.namelist() if name.startswith("sitl_mock/")
        }


@pytest.mark.flight  # building them needs hatchling
def test_both_wheels_have_the_mock_from_the_same_files_with_the_same_version(
    mock_wheel, project_wheel
):
    alone = files_of_mock(mock_wheel)
    assert alone.pop("sitl_mock/LICENSE") == (ROOT / "LICENSE").read_bytes()
    assert "sitl_mock/pyproject.toml" not in alone
    assert alone == files_of_mock(project_wheel)
    assert MOCK_PROJECT["version"] == PROJECT["version"]


def test_the_mock_needs_nothing_that_the_project_needs_in_another_version():
    of_project = {*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["plot"]}
    extras = MOCK_PROJECT["optional-dependencies"].values()
    assert {*MOCK_PROJECT["dependencies"], *itertools.chain(*extras)} <= of_project


@pytest.mark.flight
def test_the_mock_alone_is_small_and_answers(mock_wheel, tmp_path):
    mock = Installed(mock_wheel, sys.executable, tmp_path, linked=MOCK_PROJECT["dependencies"])
    weights = mock.weights()
    assert sum(megabytes for megabytes, _ in weights.values()) < LARGEST_MOCK_MB
    others = {"pursuit-guidance", "numpy", "pymavlink", "mavsdk", "eclipse-zenoh"}
    assert others.isdisjoint(weights)
    assert mock.run("python", "-c", "import guidance").returncode == 1
    assert first_heartbeat_s(mock) < 30.0
    assert mock.run("sitl-mock", "versions", "px4@1.17", "px4@1.18").returncode == 0
    said = mock.run("sitl-mock", "--version").stdout.strip()
    assert said == f"sitl-mock of pursuit-sitl-mock {MOCK_PROJECT['version']}"
    refused = mock.run("sitl-mock", "calibrate", str(ROOT / "README.md"))
    assert (refused.returncode, "needs numpy" in refused.stderr) == (2, True)
    # A suite in the same environment finds its fixtures.
    mock.link(["pytest"])
    (tmp_path / "test_climb.py").write_text(
        "def test_it_beats(mock_vehicle):\n"
        "    vehicle = mock_vehicle.stepped('arducopter')\n"
        "    assert b''.join(vehicle.step(1.1))\n"
        "    assert mock_vehicle('px4', over=('udp',)).udp_port\n",
        encoding="utf-8",
    )
    done = mock.run("python", "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_climb.py")
    assert (done.returncode, "1 passed" in done.stdout) == (0, True), done.stdout


@pytest.mark.flight
def test_the_wheel_is_small_and_flies_with_the_mock_of_its_own_version_beside_it(
    mock_wheel, project_wheel, tmp_path
):
    base = Installed(project_wheel, sys.executable, tmp_path, linked=PROJECT["dependencies"])
    assert sum(megabytes for megabytes, _ in base.weights().values()) < LARGEST_MB
    assert base.present() == []
    assert base.run("sitl-mock", "list").returncode == 0
    base.install(mock_wheel, "--no-deps")
    flight = ("guidance", "fly", "--fast", str(ROOT / "tests" / "data" / "near_chase.toml"))
    flown = base.run(*flight)
    assert flown.returncode == 0, flown.stderr
    assert (
        "picture  needs matplotlib, which is not installed: pip install 'pursuit-guidance[plot]'"
        in flown.stdout
    )
    (about,) = tmp_path.glob("env/lib/python*/site-packages/pursuit_sitl_mock-*.dist-info/METADATA")
    older = about.read_text(encoding="utf-8").replace(
        f"\nVersion: {MOCK_PROJECT['version']}\n", "\nVersion: 0.0.1\n"
    )
    about.write_text(older, encoding="utf-8")
    for command in (flight, ("sitl-mock", "run", "--vehicles", "1", "--udp", "27000")):
        refused = base.run(*command)
        assert refused.returncode == 2
        named = f"pursuit-sitl-mock 0.0.1 and pursuit-guidance {PROJECT['version']}"
        assert named in " ".join(refused.stderr.split())
