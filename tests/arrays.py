"""The games on the arrays of PyTorch and JAX: `python -m tests arrays`.

Where both are installed beside the package, they are used. Otherwise an environment `arrays` within this one gets them
(about 900 MB), sees all packages of this one, and stays for the next time. PyTorch is named to the patch, because a pip
that may choose takes the newest, which on Linux brings several GB for a graphics card; where this release, too, does
that, install a build for the CPU beside the package first.
"""

import subprocess
import sys
import sysconfig
import tomllib
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parents[1]
TORCH = "torch==2.13.0"
MARKED = ["-m", "pytest", "-q", "-m", "arrays", "--durations", "5", "tests/game"]


def python() -> str:
    """Return an interpreter that has both."""
    if find_spec("torch") and find_spec("jax"):
        return sys.executable
    folder = Path(sys.prefix) / "arrays"
    found = folder / "bin" / "python"
    if not (folder / "complete").exists():
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        run(sys.executable, "-m", "venv", str(folder))
        (parent,) = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
        (inner,) = folder.glob("lib/python*/site-packages")
        (inner / "parent.pth").write_text(f"{parent}\n{ROOT}\n")
        run(str(found), "-m", "pip", "install", "-q", "--no-compile", TORCH, *extras["jax"])
        (folder / "complete").touch()
    return str(found)


def run(*command: str) -> None:
    """Run it, or end."""
    subprocess.run(command, cwd=ROOT, check=True)


if __name__ == "__main__":
    sys.exit(subprocess.run([python(), *MARKED], cwd=ROOT, check=False).returncode)
