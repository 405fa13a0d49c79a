"""Installs the wheel into an empty environment, as a new user does, and flies a mocked flight there.

`python -m tests install` repeats this for every Python from 3.11 on that it finds; the tests use their own Python. It
prints the size of the base installation by package and the size of its four foundations. Then it removes the unused
files with the commands from the how-to page for Raspberry Pi and Jetson, prints the size again and repeats the flight.
Last it installs the mock alone from its own folder, and prints its size and the time to its first HEARTBEAT.
"""

import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Mapping, Sequence
from importlib.metadata import distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
MOCK = ROOT / "sitl_mock"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
MOCK_PROJECT = tomllib.loads((MOCK / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LARGEST_MB = 235
"""Size limit of the base installation, without pip and bytecode caches."""

LARGEST_TRIMMED_MB = 150
"""Size limit after the unused files are removed."""

LARGEST_MOCK_MB = 40
"""Size limit of the mock alone with what it imports, without pip and bytecode caches."""

TRIMMED_BY = ROOT / "docs" / "how-to" / "raspberry-pi-jetson.md"
"""The page with the commands that remove unused files."""

FOUNDATIONS = ("numpy", "mavsdk", "pymavlink", "eclipse-zenoh")
"""The large dependencies of the base: games, both links, the mock's messages and the wires."""

_WEIGHED = """
import json, pathlib, re
from importlib.metadata import distributions
weighed = {}
for one in distributions():
    files = [pathlib.Path(one.locate_file(file)) for file in one.files or () if file.suffix != ".pyc"]
    needs = [re.match(r"[\\w.-]+", need)[0] for need in one.requires or () if "extra ==" not in need]
    name = one.metadata["Name"].lower().replace("_", "-")
    weighed[name] = sum(file.stat().st_size for file in files if file.exists()) / 1e6, needs
print(json.dumps(weighed))
"""

OF_EXTRAS = (
    "dask",
    "distributed",
    "matplotlib",
    "pandas",
    "pyarrow",
    "rerun",
    "rosbags",
    "scipy",
    "xxhash",
)


def pythons() -> list[str]:
    """Return one interpreter per version from 3.11 on, from PATH and pyenv."""
    found: dict[tuple[int, ...], str] = {tuple(sys.version_info[:2]): sys.executable}
    for minor in range(11, 15):
        path = shutil.which(f"python3.{minor}")
        installed = (Path.home() / ".pyenv" / "versions").glob(f"3.{minor}.*/bin/python3")
        candidates = ([path] if path else []) + [str(one) for one in sorted(installed)]
        for candidate in candidates:
            told = subprocess.run(
                [candidate, "-c", "import venv, ensurepip"], capture_output=True, check=False
            )
            if told.returncode == 0:
                found.setdefault((3, minor), candidate)
    return [found[version] for version in sorted(found)]


def wheel(folder: Path, project: Path = ROOT) -> Path:
    """Build the wheel of a project into an empty folder with the installed build backend."""
    pip = (sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation")
    quiet("pip", *pip, "-w", str(folder), str(project))
    (built,) = folder.glob("*.whl")
    return built


class Installed:
    """A wheel in an environment of its own, used from a folder that is not the checkout.

    With `linked`, the packages that it needs are links to those of this environment, which takes a tenth of the time.
    """

    def __init__(
        self,
        built: Path,
        python: str,
        folder: Path,
        *,
        linked: Sequence[str] = (),
    ) -> None:
        self.folder = folder
        self.bin = folder / "env" / "bin"
        quiet("venv", python, "-m", "venv", "--without-pip", str(folder / "env"))
        self.link(linked)
        self.install(built, *(["--no-deps"] if linked else []))

    def install(self, built: Path, *options: str) -> None:
        """Install a wheel."""
        pip = (sys.executable, "-m", "pip", "--python", str(self.bin / "python"))
        quiet("pip", *pip, "install", "-q", "--no-compile", *options, str(built))

    def link(self, packages: Sequence[str]) -> None:
        """Link packages of this environment with what they need, and no other."""
        (site,) = self.folder.glob("env/lib/python*/site-packages")
        linked = set[str]()
        open_needs = [Requirement(package) for package in packages]
        while open_needs:
            name = canonicalize_name(open_needs.pop().name)
            if name in linked:
                continue
            linked.add(name)
            package = distribution(name)
            there = {"..", "__pycache__", *(path.name for path in site.iterdir())}
            for top in {file.parts[0] for file in package.files or ()} - there:
                (site / top).symlink_to(Path(str(package.locate_file(top))))
            needs = (Requirement(need) for need in package.requires or ())
            open_needs += [
                need for need in needs if need.marker is None or need.marker.evaluate({"extra": ""})
            ]

    def trim(self) -> None:
        """Remove unused files with the commands of the page."""
        (packages,) = self.folder.glob("env/lib/python*/site-packages")
        for line in trimming():
            quiet("trimming", "sh", "-c", line, folder=packages)

    def run(self, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run a command without the Python variables of the checkout's environment."""
        plain = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("PYTHON", "VIRTUAL_ENV"))
        }
        command = [str(self.bin / program), *arguments]
        environment = plain | {"PYTHONDONTWRITEBYTECODE": "1"}
        return subprocess.run(
            command,
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )

    def present(self) -> list[str]:
        """Return the packages of extras that were installed although they should not be."""
        code = f"import importlib.util as u; print(*[n for n in {OF_EXTRAS!r} if u.find_spec(n)])"
        return self.run("python", "-c", code).stdout.split()

    def weights(self) -> dict[str, tuple[float, list[str]]]:
        """Return the size in MB and the dependencies of every package, by name."""
        weighed: dict[str, tuple[float, list[str]]] = json.loads(
            self.run("python", "-c", _WEIGHED).stdout
        )
        return weighed

    @property
    def megabytes(self) -> float:
        """Size of the environment."""
        return (
            sum(
                path.lstat().st_size
                for path in (self.folder / "env").rglob("*")
                if not path.is_symlink()
            )
            / 1e6
        )


def first_heartbeat_s(mock: Installed) -> float:
    """Start a mocked PX4 and return how long its first HEARTBEAT took."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        client.settimeout(30.0)
        port = client.getsockname()[1]
        command = [str(mock.bin / "sitl-mock"), "run", "--vehicles", "1", "--udp", str(port)]
        started = time.perf_counter()
        with subprocess.Popen(command, cwd=mock.folder, stdout=subprocess.DEVNULL) as process:
            try:
                while client.recv(65536)[7:10] != bytes(3):
                    pass
                return time.perf_counter() - started
            finally:
                process.terminate()


def trimming() -> list[str]:
    """Return the commands that remove unused files; they run in site-packages."""
    lines = TRIMMED_BY.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line.startswith("find ")]


def quiet(what: str, *command: str, folder: Path = ROOT) -> None:
    """Run a command; if it fails, raise with its output."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{what} failed: {done.stdout}{done.stderr}")


def foundations_mb(weights: Mapping[str, tuple[float, list[str]]]) -> float:
    """Return the size of the foundations with all their dependencies."""
    held = set[str]()
    wanted = list(FOUNDATIONS)
    while wanted:
        name = wanted.pop().lower().replace("_", "-")
        if name in weights and name not in held:
            held.add(name)
            wanted += weights[name][1]
    return sum(weights[name][0] for name in held)


def show(weights: Mapping[str, tuple[float, list[str]]]) -> None:
    """Print the packages of at least a megabyte, and the size of the foundations."""
    heavy = sorted(((mb, name) for name, (mb, _) in weights.items() if mb >= 1.0), reverse=True)
    light = [mb for mb, _ in weights.values() if mb < 1.0]
    for mb, name in (*heavy, (sum(light), f"{len(light)} more")):
        print(f"  {mb:6.1f} MB  {name}")
    print(
        f"  {foundations_mb(weights):6.1f} MB of it are {', '.join(FOUNDATIONS)} with what they need",
        flush=True,
    )


def flies(base: Installed, most_mb: float) -> bool:
    """Fly a mocked flight; print the installed size and the flight's result in one line."""
    started = time.perf_counter()
    megabytes = base.megabytes
    version = base.run("python", "--version").stdout.strip()
    flown = base.run("guidance", "fly", "--fast")
    ended = re.search(r"flight ended\s+(.*)", flown.stdout)
    print(
        f"{version}: {megabytes:.0f} MB, of extras {base.present() or 'nothing'}, "
        f"guidance fly --fast ends with {flown.returncode} ({ended[1].strip() if ended else flown.stderr.strip()}), "
        f"in {time.perf_counter() - started:.0f} s",
        flush=True,
    )
    return not flown.returncode and not base.present() and megabytes <= most_mb


def main() -> int:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        built = wheel(folder)
        for number, python in enumerate(pythons()):
            (folder / str(number)).mkdir()
            base = Installed(built, python, folder / str(number))
            if number == 0:
                show(base.weights())
            if not flies(base, LARGEST_MB):
                return 1
        print("without unused files:", flush=True)
        base.trim()
        show(base.weights())
        if not flies(base, LARGEST_TRIMMED_MB):
            return 1
        return 0 if mock_alone(folder / "mock") else 1


def mock_alone(folder: Path) -> bool:
    """Install the mock alone; print its size and how soon it answers."""
    folder.mkdir()
    mock = Installed(wheel(folder, MOCK), sys.executable, folder)
    weights = mock.weights()
    print("the mock alone:", flush=True)
    for name, (megabytes, _) in sorted(weights.items(), key=lambda item: -item[1][0]):
        print(f"  {megabytes:6.1f} MB  {name}")
    first_heartbeat_s(mock)  # Python compiles the modules once
    waits_s = sorted(first_heartbeat_s(mock) for _ in range(5))
    total_mb = sum(megabytes for megabytes, _ in weights.values())
    print(f"  {total_mb:6.1f} MB in all; first HEARTBEAT after {waits_s[2]:.2f} s (median of 5)")
    return total_mb <= LARGEST_MOCK_MB


if __name__ == "__main__":
    sys.exit(main())
