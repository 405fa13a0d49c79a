"""Faults of links, flights and evaders: seeded, scripted in TOML, applied to a stepped or a live vehicle."""

from sitl_mock.faults.effect import Direction, FaultKind, Group
from sitl_mock.faults.faulted import STATES, Faulted
from sitl_mock.faults.script import (
    KINDS,
    Fault,
    FaultScript,
    parse_fault,
    parse_script,
    read_script,
)
from sitl_mock.tables import Option

__all__ = [
    "KINDS",
    "STATES",
    "Direction",
    "Fault",
    "FaultKind",
    "FaultScript",
    "Faulted",
    "Group",
    "Option",
    "parse_fault",
    "parse_script",
    "read_script",
]
