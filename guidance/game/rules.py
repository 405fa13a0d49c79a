"""The whole definition of a game: mathematics, flights, teams, coordinator, results and reports build theirs here.

`Game` has defaults, which are the paper's game. A scenario or a vehicle file defines every part, and a part that
its reader forgets would silently be another game. So every part of `Rules` has to be given.
"""

from typing import Annotated, NamedTuple

from pydantic import AfterValidator

from guidance.game.arrays import Plane, Real
from guidance.game.extent import Extent
from guidance.game.game import Game, StandOff
from guidance.game.speed_sets import SPEED_SETS, SpeedSet, speed_set_named

SpeedSetName = Annotated[str, AfterValidator(SPEED_SETS.checked_name), SPEED_SETS.names_in_schema()]
"""Type of a key that names a speed set."""


class Rules(NamedTuple):
    """The rules of a game, as files give them; numbers may be arrays, as in `Game`.

    Attributes:
        speed_set: name of the pursuer's speed set.
        speeds_m_s: horizontal speed, climb and descent of the pursuer; a ball uses the first one only.
        evader_speed_m_s: bound of the evader's speed.
        capture_radius_m: distance from the stand-off disc that counts as capture.
        standoff_radius_m: radius of the disc.
        standoff_height_m: height of the disc above the evader's plane.
        wind_m_s: velocity of the air, which carries the pursuer.
        target_velocity_m_s: velocity of the evader's target.
        target_extent: shape of the evader's target.
    """

    speed_set: SpeedSetName
    speeds_m_s: tuple[Real, Real, Real]
    evader_speed_m_s: Real
    capture_radius_m: Real
    standoff_radius_m: Real
    standoff_height_m: Real
    wind_m_s: Plane
    target_velocity_m_s: tuple[float, float]
    target_extent: Extent

    @property
    def pursuer(self) -> SpeedSet:
        """The pursuer's speed set."""
        return speed_set_named(self.speed_set).of(*self.speeds_m_s)


def game_by(rules: Rules) -> Game:
    """Return the game that some rules define.

    Raises:
        ConfigError: as `Game`.
    """
    return Game(
        rules.pursuer,
        rules.evader_speed_m_s,
        capture_radius_m=rules.capture_radius_m,
        standoff=StandOff(rules.standoff_radius_m, rules.standoff_height_m),
        wind_m_s=rules.wind_m_s,
        target_velocity_m_s=rules.target_velocity_m_s,
        target_extent=rules.target_extent,
    )
