"""The speed limits of a flight as files give them: keys of their own, the same for vehicles and scenarios."""

from typing import NamedTuple

from pydantic import Field

from guidance.config import Section

ABOVE_THE_GAME = 1.1
"""Speed limits that no file gives are this much of the game's speeds; what lies between is for catching up."""

_DEFAULT = f"; {ABOVE_THE_GAME - 1.0:.0%} above the game's if not given"


class Speeds(NamedTuple):
    """What a vehicle flies over ground, upwards and downwards, m/s."""

    speed_m_s: float
    climb_m_s: float
    descent_m_s: float


class SpeedLimits(Section):
    """Part of a file's `[limits]`: what no command ever exceeds. The game plays with speeds of its own."""

    speed_m_s: float | None = Field(None, gt=0.0, le=33.0, description=f"over ground, of every command{_DEFAULT}")
    climb_m_s: float | None = Field(None, gt=0.0, le=11.0, description=f"of every command{_DEFAULT}")
    descent_m_s: float | None = Field(None, gt=0.0, le=11.0, description=f"of every command{_DEFAULT}")

    def speeds(self, game: Speeds, *, section: str) -> Speeds:
        """Return the limits of a flight that plays with these speeds.

        Args:
            game: The game's speeds.
            section: Of the file in which those stand.

        Raises:
            ValueError: If a limit is below the game's speed; the message names both keys.
        """
        return Speeds(*(self._limit(name, played, section) for name, played in game._asdict().items()))

    def _limit(self, name: str, played_m_s: float, section: str) -> float:
        limit_m_s: float | None = getattr(self, name)
        if limit_m_s is None:
            return ABOVE_THE_GAME * played_m_s
        if limit_m_s < played_m_s:
            raise ValueError(
                f"limits.{name} = {limit_m_s:g}: must be at least {section}.{name} = {played_m_s:g}, with which the "
                "game is played; raise the one or play with less"
            )
        return limit_m_s
