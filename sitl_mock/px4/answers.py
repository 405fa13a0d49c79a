"""The answers that most commands get."""

from collections.abc import Sequence
from typing import Final

from sitl_mock.protocols import CommandAnswer, Result

Answers = Sequence[CommandAnswer]

ACCEPTED: Final = (CommandAnswer(Result.ACCEPTED),)
REFUSED: Final = (CommandAnswer(Result.TEMPORARILY_REJECTED),)
DENIED: Final = (CommandAnswer(Result.DENIED),)
UNSUPPORTED: Final = (CommandAnswer(Result.UNSUPPORTED),)
SILENCE: Final[Answers] = ()
