"""An evader that circles: how it turns, whether the pursuit falls behind its promise, and where to meet it then.

The game's pursuer turns at once, so every turn of the evader gains it ground. A vehicle with bounded acceleration that
flies at an evader on a small circle may go round after it for ever, because at its speed it cannot turn as fast.
It notices this, because its time to capture does not fall as promised. The later it is, the more it flies to the
earliest point that it can reach of the path that the evader's turn predicts: it cuts the circle, or waits on it.

An evader that a vehicle can follow round its turns, at the vehicle's own speed, is pursued by the game's solution
unchanged, such as one that runs straight. Turns that last for seconds look like a circle, so they may cost time.
"""

import math
from typing import Final, NamedTuple

from guidance.control.braking_law import approach_speed
from guidance.cycle.players import Capability, Players, late_start
from guidance.frames import Enu
from guidance.game import Game

LATE_PURSUIT_S: Final = 1.0
LATE_M: Final = 1.0
"""A pursuit is late after this delay and the time to close this distance, which cover errors of the estimates."""

WHOLLY_S: Final = 1.0
"""With this further delay the vehicle flies only to the predicted path."""

FORGIVEN: Final = 0.2
"""A delay and an old promise fade at this rate."""

LATEST_S: Final = 6.0
"""Larger delays count as this one."""

TURN_S: Final = 1.5
"""Time constant of the mean turn rate: weaving averages out."""

_SHARPEST_RAD_S: Final = 2.0
"""Faster turns count as this one. A reversal is no part of a circle."""

_AHEAD_S: Final = 15.0
_STEP_S: Final = 0.1
_LEAST_M_S: Final = 0.5
_NO_TURN_RAD: Final = 1e-6
_STILL: Final = Enu((0.0, 0.0, 0.0))


class Circling(NamedTuple):
    """Memory between cycles.

    Attributes:
        evader_m_s: Velocity of the evader in the last cycle, game frame; None before the first.
        turn_rad_s: Its mean turn rate, from east to north.
        observed_s: Time over which it was observed.
        promised_s: Least time to capture promised so far, less the time since; infinite before the first promise.
        late_s: By how much the present promise is later than that, or a delay before it that is not forgiven yet: a
            vehicle that missed the evader once keeps cutting its circle.
    """

    evader_m_s: Enu | None = None
    turn_rad_s: float = 0.0
    observed_s: float = 0.0
    promised_s: float = math.inf
    late_s: float = 0.0

    def after(self, evader_m_s: Enu, needed_s: float, dt_s: float) -> "Circling":
        """Return the memory after a cycle.

        Args:
            evader_m_s: Estimated velocity of the evader, game frame.
            needed_s: Time to capture an evader that runs straight away from now on.
            dt_s: Time since the last cycle.
        """
        turn_rad_s = self.turn_rad_s
        observed_s = self.observed_s
        before_m_s = self.evader_m_s
        if before_m_s is not None and dt_s > 0.0:
            slowest_m_s = min(before_m_s.level_length(), evader_m_s.level_length())
            if slowest_m_s > _LEAST_M_S:
                across = before_m_s.east * evader_m_s.north - before_m_s.north * evader_m_s.east
                turned_rad = math.atan2(across, before_m_s.level_dot(evader_m_s))
                observed_s += dt_s
                weight = dt_s / max(dt_s, min(TURN_S, observed_s))
                rate_rad_s = min(_SHARPEST_RAD_S, max(-_SHARPEST_RAD_S, turned_rad / dt_s))
                turn_rad_s += weight * (rate_rad_s - turn_rad_s)
        promised_s = min(needed_s, self.promised_s - (1.0 - FORGIVEN) * dt_s)
        promised_s = max(promised_s, needed_s - LATEST_S)
        late_s = max(needed_s - promised_s, self.late_s - FORGIVEN * dt_s)
        return Circling(evader_m_s, turn_rad_s, observed_s, promised_s, late_s)

    def sharpness(self, game: Game, vehicle: Capability) -> float:
        """Return whether the evader turns too fast for the vehicle at its speed, from 0 (it does not) to 1."""
        needed_m_s2 = game.pursuer.horizontal_m_s * abs(self.turn_rad_s)
        return min(1.0, max(0.0, 2.0 * needed_m_s2 / vehicle.acceleration.ground_m_s2 - 1.0))

    def noticed_s(self, game: Game) -> float:
        """Return the delay that counts as fully late."""
        return (
            LATE_PURSUIT_S
            + LATE_M / (game.pursuer.horizontal_m_s - game.evader_speed_m_s)
            + WHOLLY_S
        )

    def share(self, game: Game, vehicle: Capability) -> float:
        """Return how much of the velocity leads to the predicted path, 0 to 1."""
        lateness = 1.0 + (self.late_s - self.noticed_s(game)) / WHOLLY_S
        return self.sharpness(game, vehicle) * min(1.0, max(0.0, lateness))

    def detour_s(self, game: Game, vehicle: Capability) -> float:
        """Return the time lost to an evader that keeps circling: until the vehicle notices, and one round."""
        sharpness = self.sharpness(game, vehicle)
        if sharpness == 0.0:
            return 0.0
        return sharpness * (self.noticed_s(game) + 2.0 * math.pi / abs(self.turn_rad_s))

    def place_m(self, evader_m: Enu, after_s: float) -> Enu:
        """Return the evader's place after a time if it keeps turning like this, game frame."""
        half_rad = 0.5 * self.turn_rad_s * after_s
        chord_s = after_s
        if abs(half_rad) > _NO_TURN_RAD:
            chord_s *= math.sin(half_rad) / half_rad
        cos = math.cos(half_rad)
        sin = math.sin(half_rad)
        east_m_s, north_m_s, _ = _STILL if self.evader_m_s is None else self.evader_m_s
        way_east_m = chord_s * (cos * east_m_s - sin * north_m_s)
        way_north_m = chord_s * (sin * east_m_s + cos * north_m_s)
        return evader_m + Enu((way_east_m, way_north_m, 0.0))


def meeting_velocity(
    game: Game, players: Players, vehicle: Capability, circling: Circling, optimal_m_s: Enu
) -> Enu:
    """Return the velocity to the earliest meeting with an evader that keeps turning as before, game frame.

    It is the game's where there is no such meeting within `_AHEAD_S`. A vehicle that has time to spare, because the
    evader still has to come, or because of its height, flies more slowly, and brakes for the place.

    Args:
        game: The present game.
        players: From where.
        vehicle: Its limits and accelerations.
        circling: How the evader has turned.
        optimal_m_s: Velocity of the game's solution; the height is flown by it.
    """
    u = game.pursuer.horizontal_m_s
    radius_m = float(game.standoff.radius_m)
    envelope = vehicle.envelope
    P = players.pursuer_m
    flown_m_s = players.pursuer_m_s
    after_s = 0.0
    if abs(players.gaps.height_m) > vehicle.tolerance_m:
        late = late_start(P, optimal_m_s, flown_m_s, vehicle.acceleration)
        missing_m = abs(late.up - players.evader_m.up - game.standoff.height_m)
        rate_m_s = max(_LEAST_M_S, abs(optimal_m_s.up)) * vehicle.acceleration.descent_share
        after_s = missing_m / rate_m_s
    while after_s <= _AHEAD_S:
        place_m = circling.place_m(players.evader_m, after_s)
        way_m = (place_m - P).level_with(0.0)
        away_m = way_m.level_length()
        towards = way_m / away_m if away_m > 0.0 else _STILL
        start_m = late_start(P, u * towards, flown_m_s, vehicle.acceleration)
        start_m -= 0.5 * envelope.reaction_s * (u * towards - flown_m_s)
        needed_s = ((place_m - start_m).level_length() - radius_m) / u
        if needed_s <= after_s:
            pace = max(0.0, needed_s) / after_s if after_s > 0.0 else 0.0
            stopping_m_s = approach_speed(away_m, envelope.braking_m_s2, envelope.reaction_s)
            return (min(pace * u, stopping_m_s) * towards).level_with(optimal_m_s.up)
        after_s += _STEP_S
    return optimal_m_s
