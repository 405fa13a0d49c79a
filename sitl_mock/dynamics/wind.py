"""Wind: a steady part and gusts, as first-order coloured noise from a seeded source."""

import math
from dataclasses import dataclass
from random import Random

from sitl_mock.dynamics.values import ZERO, Ned


@dataclass(frozen=True)
class Wind:
    """A steady wind with gusts.

    Attributes:
        mean_ned_m_s: Steady part: where the air goes to, not where it comes from.
        gust_sd_m_s: Standard deviation of the gusts, horizontal axes; a third of it is vertical.
        gust_time_s: Correlation time of the gusts.
    """

    mean_ned_m_s: Ned = ZERO
    gust_sd_m_s: float = 0.0
    gust_time_s: float = 3.0

    def gust_after(self, gust_ned_m_s: Ned, random: Random, dt_s: float) -> Ned:
        """The gust `dt_s` later (exact for any step); the same seed and steps give the same gusts."""
        keep = math.exp(-dt_s / self.gust_time_s)
        kick = self.gust_sd_m_s * math.sqrt(1.0 - keep * keep)
        n, e, d = gust_ned_m_s
        gauss = random.gauss
        return (
            n * keep + kick * gauss(0.0, 1.0),
            e * keep + kick * gauss(0.0, 1.0),
            d * keep + kick / 3.0 * gauss(0.0, 1.0),
        )

    def blowing(self, gust_ned_m_s: Ned) -> Ned:
        """Steady part and gust together, as `Surroundings` takes it."""
        (m_n, m_e, m_d), (n, e, d) = self.mean_ned_m_s, gust_ned_m_s
        return m_n + n, m_e + e, m_d + d
