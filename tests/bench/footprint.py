"""What a process takes of its computer (Linux), and how fast that grows."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np


class Footprint(NamedTuple):
    """Resident memory, open descriptors and threads."""

    memory_mb: float
    descriptors: int
    threads: int


def footprint(pid: int | None = None) -> Footprint:
    """Return a process's, or our own."""
    proc = Path("/proc") / (str(pid) if pid is not None else "self")
    pages = int((proc / "statm").read_text().split()[1])
    return Footprint(
        pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
        len(list((proc / "fd").iterdir())),
        len(list((proc / "task").iterdir())),
    )


def growth_mb_h(hours: Sequence[float], taken: Sequence[Footprint]) -> float:
    """Return the slope of the straight line through the memory at these times, MB an hour."""
    return float(np.polyfit(hours, [one.memory_mb for one in taken], 1)[0])


def told(hours: Sequence[float], taken: Sequence[Footprint]) -> str:
    """Say first, most and last, and the slope."""
    memory = [one.memory_mb for one in taken]
    counted = (
        f"{name} {taken[0][index]} to {taken[-1][index]} (most {max(one[index] for one in taken)})"
        for index, name in ((1, "descriptors"), (2, "threads"))
    )
    return (
        f"memory {memory[0]:.1f} to {memory[-1]:.1f} MB (most {max(memory):.1f}): {growth_mb_h(hours, taken):+.2f} MB "
        f"an hour; {', '.join(counted)}"
    )
