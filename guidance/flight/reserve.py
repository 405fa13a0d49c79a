"""How much of the battery it takes to come home from here: by distance, height, wind and speed."""

import math
from dataclasses import dataclass, fields

from guidance.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Reserve:
    """What the way home is reckoned by.

    Attributes:
        endurance_s: How long a full charge lasts in flight.
        left: Share of the charge, 0 to 1, that is to be left on the ground.
        return_speed_m_s: The autopilot's own, on its way home, through the air.
        landing_speed_m_s: Likewise, downwards.
        wind_m_s: Against it at worst.

    Raises:
        ConfigError: If a number is out of its range, or the wind as fast as the vehicle.
    """

    endurance_s: float
    left: float = 0.1
    return_speed_m_s: float = 5.0
    landing_speed_m_s: float = 0.7
    wind_m_s: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            least = 0.0 if field.name in {"left", "wind_m_s"} else 1e-3
            if not least <= value <= (1.0 if field.name == "left" else 1e6):
                raise ConfigError(f"reserve.{field.name} = {value}: not in its range")
        if self.wind_m_s >= self.return_speed_m_s:
            raise ConfigError(
                f"reserve.wind_m_s = {self.wind_m_s:g}: must be below reserve.return_speed_m_s = "
                f"{self.return_speed_m_s:g}: against such a wind nothing comes home"
            )

    def needed(self, away_m: float, height_m: float) -> float:
        """Return the share of the charge that is needed to come home and land.

        Args:
            away_m: From home, over the ground.
            height_m: Above home.
        """
        home_s = abs(away_m) / (self.return_speed_m_s - self.wind_m_s)
        down_s = max(0.0, height_m) / self.landing_speed_m_s
        share = self.left + (home_s + down_s) / self.endurance_s
        return min(1.0, share) if math.isfinite(share) else 1.0
