"""One guidance cycle: five steps from both players to a setpoint, the certificate, and the monitor of its promises.

Cycle (`steps`):
    play: one cycle of the game, from `CycleInputs`, `CycleSettings` and `CycleMemory` to a `CycleOutput`.
    hover: one cycle without a game. game_played: the game of a cycle, a `GamePlayed`.

Certificate (`certificate`):
    certify: the game's result, this vehicle's promises and the `ChosenCourse` that it flies, as a `Certified`.
    Certificate: the statement of one cycle. Players, Capability (`players`): its inputs.
    Guarding of the target in TAD: `guarding`.

Monitor (`monitor`):
    watch: compare a certificate with the promises before it, which a `MonitorMemory` keeps.
    Alarm: a promise that was not kept. Violation: which one.
"""

from guidance.cycle.certificate import Certificate, Certified, ChosenCourse, certify
from guidance.cycle.monitor import Alarm, MonitorMemory, Violation, watch
from guidance.cycle.players import Capability, Players
from guidance.cycle.steps import (
    CycleInputs,
    CycleMemory,
    CycleOutput,
    CycleSettings,
    GamePlayed,
    game_played,
    hover,
    play,
)

__all__ = [
    "Alarm",
    "Capability",
    "Certificate",
    "Certified",
    "ChosenCourse",
    "CycleInputs",
    "CycleMemory",
    "CycleOutput",
    "CycleSettings",
    "GamePlayed",
    "MonitorMemory",
    "Players",
    "Violation",
    "certify",
    "game_played",
    "hover",
    "play",
    "watch",
]
