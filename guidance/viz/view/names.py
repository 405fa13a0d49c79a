"""Where everything is in a recording of Rerun, and its colour."""

from collections.abc import Mapping
from typing import Final

PURSUER: Final = "game/pursuer"
EVADER: Final = "game/evader"
DISC: Final = "game/stand_off_disc"
ISOCHRON: Final = "game/isochron"
MEETING: Final = "game/meeting_point"
FENCE: Final = "game/fence"
TARGET: Final = "game/target"
GUARANTEE: Final = "plots/guarantee"
STATE: Final = "state"
EVENTS: Final = "events"

COLUMN: Final[Mapping[str, str]] = {PURSUER: "pursuer_m", EVADER: "evader_m"}
"""Which of a cycle's numbers says where it is."""

Colour = tuple[int, int, int]

COLOURS: Final[Mapping[str, Colour]] = {
    PURSUER: (214, 69, 58),
    EVADER: (66, 140, 214),
    DISC: (76, 175, 80),
    ISOCHRON: (190, 190, 190),
    MEETING: (250, 214, 60),
    FENCE: (240, 150, 40),
}
