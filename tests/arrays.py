"""The games on the arrays of PyTorch and JAX: `python -m tests arrays`, or `python -m tests.arrays` without a limit,
with the games too that a library compiles for many seconds.

If both are installed, this environment is used. Otherwise they are installed into a nested environment `arrays` (300 MB
to download, 1 GB on disk), which also sees this environment's packages and is kept for the next run. The PyTorch
version is pinned, because the newest release on Linux downloads several GB for a graphics card. If the pinned one does
so too, install a CPU build of PyTorch in this environment first.
"""

import argparse
import os
import subprocess
import sys
import sysconfig
import tomllib
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parents[1]
TORCH = "torch==2.13.0"
PYTEST = ("-m", "pytest", "-q", "--durations", "5", "tests/game", "-m")


def python(within_s: float | None) -> str:
    """Return an interpreter that has both.

    Args:
        within_s: Time limit of the installation; None for no limit.

    Raises:
        SubprocessError: If the installation fails or exceeds the limit.
    """
    if find_spec("torch") and find_spec("jax"):
        return sys.executable
    folder = Path(sys.prefix) / "arrays"
    found = folder / "bin" / "python"
    if not (folder / "complete").exists():
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
            "optional-dependencies"
        ]
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
        (parent,) = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
        (inner,) = folder.glob("lib/python*/site-packages")
        (inner / "parent.pth").write_text(f"{parent}\n{ROOT}\n")
        pip = (sys.executable, "-m", "pip", "--python", str(found), "install", "-q", "--no-compile")
        subprocess.run([*pip, TORCH, *extras["jax"]], cwd=ROOT, check=True, timeout=within_s)
        (folder / "complete").touch()
    return str(found)


def main() -> int:
    """Run the tests. With a time limit, a failed installation only prints a notice."""
    parser = argparse.ArgumentParser(prog="python -m tests.arrays", description=__doc__)
    parser.add_argument(
        "--within", type=float, metavar="SECONDS", help="skip the tests if installing takes longer"
    )
    given = parser.parse_args()
    try:
        found = python(given.within)
    except subprocess.SubprocessError:
        if given.within is None:
            raise
        print(
            f"PyTorch and JAX not installed within {given.within:g} s: NO game was run on them",
            flush=True,
        )
        return 0
    # JAX compiles each operation for a few calls: optimizing that code takes longer than running it. With 40 rows a
    # second thread waits more than it computes.
    flags = (
        "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true "
        "--xla_cpu_multi_thread_eigen=false"
    )
    environment = {"XLA_FLAGS": flags, "OMP_NUM_THREADS": "1", **os.environ}
    marked = "arrays" if given.within is None else "arrays and not long"
    command = [found, *PYTEST, marked]
    return subprocess.run(command, cwd=ROOT, check=False, env=environment).returncode


if __name__ == "__main__":
    sys.exit(main())
