"""Commands that PX4 v1.17 only answers, or does not answer at all: asked one by one, parameters zero, on the ground.

Whatever is in no table here and has no handler in `commands.py` is UNSUPPORTED.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

from sitl_mock.protocols import CommandAnswer, Result

Answers = Sequence[CommandAnswer]

ACCEPTED: Final = (CommandAnswer(Result.ACCEPTED),)
REFUSED: Final = (CommandAnswer(Result.TEMPORARILY_REJECTED),)
DENIED: Final = (CommandAnswer(Result.DENIED),)
UNSUPPORTED: Final = (CommandAnswer(Result.UNSUPPORTED),)
SILENCE: Final[Answers] = ()


_TAKEN: Final = frozenset({80, 187, 191, 195, 196, 197, 201, 245, 401, 2510, 42006, 43003})
"""Region of interest, go-around, actuators, storage, arming checks, logging, compass by heading, external position."""
_UNANSWERED: Final = frozenset(
    {35, 93, 203, 204, 205, 206, 214, 220, 242, 243, 260, 310, 311, 420, 500, 521}
    | {530, 531, 532, 1000, 1001, 2003, 2511, 3000, 30001, 30002, 42600}
)
"""For cameras, gimbals, grippers and other parts that are not there: passed on, and nobody answers."""
_OTHER: Final[Mapping[int, Answers]] = {
    189: (CommandAnswer(Result.CANCELLED),),
    211: (CommandAnswer(Result.IN_PROGRESS),),
    212: (CommandAnswer(Result.IN_PROGRESS),),
    262: (CommandAnswer(Result.FAILED),),
    2600: (CommandAnswer(Result.FAILED),),
    43004: (CommandAnswer(Result.ACCEPTED), CommandAnswer(Result.UNSUPPORTED, delay_s=0.02)),
}

PLAIN: Final[Mapping[int, Answers]] = MappingProxyType(
    dict.fromkeys(_TAKEN, ACCEPTED) | dict.fromkeys(_UNANSWERED, SILENCE) | dict(_OTHER)
)
