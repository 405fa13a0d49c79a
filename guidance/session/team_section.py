"""The section `[team]` of vehicle files: the mates, and the evaders besides `[evader]`."""

from collections.abc import Iterator

from pydantic import Field, SerializeAsAny

from guidance.config import Name
from guidance.cycle.section import GameSection
from guidance.flight.settings import TeamSection
from guidance.links.evaders.section import EvaderSection


class TeamEvader(EvaderSection):
    """An evader besides `[evader]`. On the vehicle's link only that one may report."""

    url: str = Field(description="where its reports arrive")
    speed_m_s: float = Field(gt=0.0, le=30.0, description="declared top speed of the evader")


class Team(TeamSection):
    """The team of the vehicle. Its messages pass the session of `[control]`, which all mates share."""

    name: Name = Field(description="of the team, in orders: guidance ctl engage --team NAME")
    mates: tuple[Name, ...] = Field(
        min_length=1, max_length=31, description="names of the other vehicles"
    )
    evader: Name = Field(
        description="name of the evader of [evader], against which the vehicle plays first"
    )
    evaders: dict[Name, SerializeAsAny[TeamEvader]] = Field(
        {}, description="[team.evaders.NAME]: the other evaders"
    )

    def faults_beside(self, name: str, game: GameSection) -> Iterator[str]:
        """Yield its faults in combination with a file's name and `[game]`."""
        if len({name, *self.mates}) <= len(self.mates):
            yield f"team.mates = {list(self.mates)}: must be other names than {name!r}, each once"
        if self.evader in self.evaders:
            yield f"team.evaders.{self.evader}: is [evader] already (team.evader); name only the others"
        if any(game.target_velocity_m_s):
            moves = f"game.target_velocity_m_s = {list(game.target_velocity_m_s)}"
            reason = "the vehicles would count the target's way from different moments"
            yield f"{moves}: must be zero with [team]: {reason}"
        for evader_name, evader in self.evaders.items():
            if evader.speed_m_s >= game.speed_m_s:
                key = f"team.evaders.{evader_name}.speed_m_s"
                allowed = f"game.speed_m_s = {game.speed_m_s:g}"
                yield f"{key} = {evader.speed_m_s:g}: must be below {allowed}"
