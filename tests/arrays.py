"""The games on the arrays of PyTorch and JAX: `python -m tests arrays`, or `python -m tests.arrays` without a limit.

Where both are installed beside the package, they are used. Otherwise an environment `arrays` within this one gets them
(300 MB to load, 1 GB on disk), sees all packages of this one, and stays for the next time. PyTorch is named to the
patch, because a pip that may choose takes the newest, which on Linux brings several GB for a graphics card; where this
release, too, does that, install a build for the CPU beside the package first.
"""

import argparse
import subprocess
import sys
import sysconfig
import tomllib
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parents[1]
TORCH = "torch==2.13.0"
MARKED = ["-m", "pytest", "-q", "-m", "arrays", "--durations", "5", "tests/game"]


def python(within_s: float | None) -> str:
    """Return an interpreter that has both.

    Args:
        within_s: What has not arrived by then is not waited for.

    Raises:
        SubprocessError: They cannot be had, or not by then.
    """
    if find_spec("torch") and find_spec("jax"):
        return sys.executable
    folder = Path(sys.prefix) / "arrays"
    found = folder / "bin" / "python"
    if not (folder / "complete").exists():
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        (parent,) = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
        (inner,) = folder.glob("lib/python*/site-packages")
        (inner / "parent.pth").write_text(f"{parent}\n{ROOT}\n")
        pip = (str(found), "-m", "pip", "install", "-q", "--no-compile")
        subprocess.run([*pip, TORCH, *extras["jax"]], cwd=ROOT, check=True, timeout=within_s)
        (folder / "complete").touch()
    return str(found)


def main() -> int:
    """Run the tests; where a limit is given and they cannot be had by then, say so."""
    parser = argparse.ArgumentParser(prog="python -m tests.arrays", description=__doc__)
    parser.add_argument("--within", type=float, metavar="SECONDS", help="do without what takes longer")
    given = parser.parse_args()
    try:
        found = python(given.within)
    except subprocess.SubprocessError:
        if given.within is None:
            raise
        print(f"PyTorch and JAX are not to be had within {given.within:g} s: NO game was run on them", flush=True)
        return 0
    return subprocess.run([found, *MARKED], cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
