"""What a process takes of its computer (Linux), and how fast that grows."""

import itertools
import os
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np

FLAT_MB_H = 2.0


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
    """Return the memory's slope, MB an hour: the median of those between any two looks (Theil and Sen).

    A step, as an allocator takes memory by the arena, and a look that fell on a peak, do not tilt it.
    """
    before, after = np.triu_indices(len(taken), 1)
    memory = np.array([one.memory_mb for one in taken])
    at = np.asarray(hours)
    return float(np.median((memory[after] - memory[before]) / (at[after] - at[before])))


def most_in_an_hour_mb(hours: Sequence[float], taken: Sequence[Footprint]) -> float:
    """Return the most memory that came between two looks at most an hour apart: what a median would not show."""
    memory = [one.memory_mb for one in taken]
    later = itertools.combinations(range(len(taken)), 2)
    return max(
        memory[after] - memory[before]
        for before, after in later
        if hours[after] - hours[before] <= 1.0
    )


def is_flat(hours: Sequence[float], taken: Sequence[Footprint]) -> bool:
    """Return whether neither the slope nor any hour is above `FLAT_MB_H`, and no more files or threads stay open."""
    half = len(taken) // 2
    counted = ([sample[1:] for sample in part] for part in (taken[:half], taken[half:]))
    before, after = (tuple(map(median, zip(*part, strict=True))) for part in counted)
    steady = all(late <= early for early, late in zip(before, after, strict=True))
    return (
        growth_mb_h(hours, taken) < FLAT_MB_H
        and most_in_an_hour_mb(hours, taken) < FLAT_MB_H
        and steady
    )


def told(hours: Sequence[float], taken: Sequence[Footprint]) -> str:
    """Say first, most and last, the slope and the worst hour."""
    memory = [one.memory_mb for one in taken]
    counted = (
        f"{name} {taken[0][index]} to {taken[-1][index]} (most {max(sample[index] for sample in taken)})"
        for index, name in ((1, "descriptors"), (2, "threads"))
    )
    return (
        f"memory {memory[0]:.1f} to {memory[-1]:.1f} MB (most {max(memory):.1f}): {growth_mb_h(hours, taken):+.2f} MB "
        f"an hour, {most_in_an_hour_mb(hours, taken):+.2f} MB in the worst; {', '.join(counted)}"
    )
