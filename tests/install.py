"""The package as a newcomer gets it: a wheel, installed into an environment where nothing else is.

`python -m tests install` does it with every Python that it finds, from 3.11 on; the tests with the one they run on.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
LARGEST_MB = 235
"""Of the base installation, without pip and without the bytecode that Python writes as it runs."""

OF_EXTRAS = ("dask", "distributed", "matplotlib", "pandas", "pyarrow", "rerun", "scipy")


def pythons() -> list[str]:
    """Return the interpreters from 3.11 on, one a version, on the path and among pyenv's."""
    found: dict[tuple[int, ...], str] = {tuple(sys.version_info[:2]): sys.executable}
    for minor in range(11, 15):
        path = shutil.which(f"python3.{minor}")
        installed = (Path.home() / ".pyenv" / "versions").glob(f"3.{minor}.*/bin/python3")
        candidates = ([path] if path else []) + [str(one) for one in sorted(installed)]
        for candidate in candidates:
            told = subprocess.run([candidate, "-c", "import venv, ensurepip"], capture_output=True, check=False)
            if told.returncode == 0:
                found.setdefault((3, minor), candidate)
    return [found[version] for version in sorted(found)]


def wheel(folder: Path) -> Path:
    """Build the wheel into a folder, by the build backend that is installed here."""
    pip = (sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation")
    quiet("pip", *pip, "-w", str(folder), str(ROOT))
    (built,) = folder.glob("*.whl")
    return built


class Installed:
    """The base installation in an environment of its own, used from a folder that is not the checkout."""

    def __init__(self, built: Path, python: str, folder: Path) -> None:
        self.folder = folder
        self.bin = folder / "env" / "bin"
        quiet("venv", python, "-m", "venv", "--without-pip", str(folder / "env"))
        pip = (sys.executable, "-m", "pip", "--python", str(self.bin / "python"))
        quiet("pip", *pip, "install", "-q", "--no-compile", str(built))
        self.megabytes = self._megabytes()

    def run(self, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run a command, without anything that the checkout's environment says."""
        plain = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
        command = [str(self.bin / program), *arguments]
        environment = plain | {"PYTHONDONTWRITEBYTECODE": "1"}
        return subprocess.run(
            command, cwd=self.folder, env=environment, capture_output=True, text=True, timeout=120, check=False
        )

    def present(self) -> list[str]:
        """Return the packages of extras that came along all the same."""
        code = f"import importlib.util as u; print(*[n for n in {OF_EXTRAS!r} if u.find_spec(n)])"
        return self.run("python", "-c", code).stdout.split()

    def _megabytes(self) -> float:
        return sum(path.lstat().st_size for path in (self.folder / "env").rglob("*") if not path.is_symlink()) / 1e6


def quiet(what: str, *command: str) -> None:
    """Run a command that must work, and tell what it said where it does not."""
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{what} failed: {done.stdout}{done.stderr}")


def main() -> int:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        built = wheel(folder)
        for number, python in enumerate(pythons()):
            started = time.perf_counter()
            (folder / str(number)).mkdir()
            base = Installed(built, python, folder / str(number))
            version = base.run("python", "--version").stdout.strip()
            flown = base.run("guidance", "fly", "--fast")
            ended = re.search(r"flight ended\s+(.*)", flown.stdout)
            print(
                f"{version}: {base.megabytes:.0f} MB, of extras {base.present() or 'nothing'}, guidance fly --fast "
                f"ends with {flown.returncode} ({ended[1].strip() if ended else flown.stderr.strip()}), "
                f"in {time.perf_counter() - started:.0f} s",
                flush=True,
            )
            if flown.returncode or base.present() or base.megabytes > LARGEST_MB:
                return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
