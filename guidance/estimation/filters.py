"""The filters of the evader's motion: interacting multiple models in the plane, and a Kalman filter of the height.

In the plane two models run side by side, steady (constant velocity) and turning (coordinated turn): mix, move, correct.
They use plain floats: NumPy takes longer to call than five numbers take to compute.

State: north, east (m), their rates (m/s); with the turning model also the turn rate (rad/s, north to east).
Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 6.2.2 (white
noise acceleration) and 11.7 (coordinated turn with unknown rate). The turn rate decays with a correlation time, so it
stays bounded without reports.

Source of the filter: Blom & Bar-Shalom (1988); Bar-Shalom, Li & Kirubarajan (2001), 11.6.6. The switching is a Markov
chain in continuous time, so the report rate does not matter. Before mixing, the steady model takes the turn rate of the
turning model, since it has none of its own (unbiased mixing: Yuan, Lian & Zhou, 2012).

The height has a filter of its own with two states, down and its rate.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from operator import itemgetter, mul
from typing import Final, NamedTuple

from guidance.estimation.measurement import TrackSettings
from guidance.frames import STILL, Ned

Components = Sequence[float]

_SMALL_TURN_RAD = 1e-3

_CELLS = tuple((row, column) for row in range(5) for column in range(row + 1))
"""Row and column of each number of a covariance; the steady model has the first ten."""


def _cell(row: int, column: int) -> int:
    """Return where a covariance keeps the number of a row and a column, in either order."""
    return _CELLS.index((max(row, column), min(row, column)))


_Pick = Callable[[Components], tuple[float, ...]]


class Layout(NamedTuple):
    """Getters that pick the numbers of a covariance, and their factors, in one step.

    Attributes:
        rows: From a covariance each of its whole rows, which are also its columns.
        by_row: From a number for every row, that of each cell.
        by_column: From a number for every column, that of each cell.
    """

    rows: tuple[_Pick, ...]
    by_row: _Pick
    by_column: _Pick


def _layout(size: int) -> Layout:
    """Return the layout for a state of this many numbers."""
    cells = [(row, column) for row, column in _CELLS if row < size]
    return Layout(
        tuple(itemgetter(*[_cell(row, column) for column in range(size)]) for row in range(size)),
        itemgetter(*[row for row, _ in cells]),
        itemgetter(*[column for _, column in cells]),
    )


_LAYOUTS: Final = {4: _layout(4), 5: _layout(5)}
"""Layouts of the steady and the turning model, by the size of their states."""

_NORTH, _EAST, _NORTH_RATE, _EAST_RATE = range(4)  # of the state
_POSITION_CELLS = (_cell(_NORTH, _NORTH), _cell(_EAST, _EAST))
_SHARED_CELLS = (_cell(_NORTH_RATE, _NORTH), _cell(_EAST_RATE, _EAST))
_RATE_CELLS = (_cell(_NORTH_RATE, _NORTH_RATE), _cell(_EAST_RATE, _EAST_RATE))
"""Cells that white acceleration makes grow: of a position, of a position and its rate, of a rate."""


class Normal(NamedTuple):
    """A normal distribution of the state: its mean (n,) and, by rows, the lower triangle of its covariance."""

    mean: Components
    covariance: Components


class Modes(NamedTuple):
    """The state as each model has it, and the probability that the evader is turning."""

    steady: Normal
    turning: Normal
    turning_share: float


def begin(measured: Components, variances: Components, settings: TrackSettings) -> Modes:
    """Begin both models with a report of position (2,), or position and velocity (4,), and its variances."""
    unknown = 4 - len(measured)
    spreads = (
        *variances,
        *[settings.prior_speed_sd_m_s**2] * unknown,
        settings.turn_rate_sd_rad_s**2,
    )
    covariance = [spreads[row] if row == column else 0.0 for row, column in _CELLS]
    mean = [*measured, *[0.0] * (unknown + 1)]
    turning = settings.turning_time_s / (settings.turning_time_s + settings.steady_time_s)
    return Modes(Normal(mean[:4], covariance[:10]), Normal(mean, covariance), turning)


class PlaneCovariance(NamedTuple):
    """Covariance of the steady model: the lower triangle by rows of north, east and their rates."""

    north_north: float
    east_north: float
    east_east: float
    north_rate_north: float
    north_rate_east: float
    north_rate_north_rate: float
    east_rate_north: float
    east_rate_east: float
    east_rate_north_rate: float
    east_rate_east_rate: float


def steady_after(state: Normal, dt_s: float, settings: TrackSettings) -> Normal:
    """Advance the steady model by dt."""
    north, east, north_rate, east_rate = state.mean
    before = PlaneCovariance(*state.covariance)
    north_east_rates = before.north_rate_east + before.east_rate_north
    after = [
        before.north_north
        + dt_s * (2.0 * before.north_rate_north + dt_s * before.north_rate_north_rate),
        before.east_north + dt_s * (north_east_rates + dt_s * before.east_rate_north_rate),
        before.east_east + dt_s * (2.0 * before.east_rate_east + dt_s * before.east_rate_east_rate),
        before.north_rate_north + dt_s * before.north_rate_north_rate,
        before.north_rate_east + dt_s * before.east_rate_north_rate,
        before.north_rate_north_rate,
        before.east_rate_north + dt_s * before.east_rate_north_rate,
        before.east_rate_east + dt_s * before.east_rate_east_rate,
        before.east_rate_north_rate,
        before.east_rate_east_rate,
    ]
    _add_acceleration(after, settings.steady_noise_m2_s3, dt_s)
    mean = (north + dt_s * north_rate, east + dt_s * east_rate, north_rate, east_rate)
    return Normal(mean, after)


def _add_acceleration(covariance: list[float], noise_m2_s3: float, dt_s: float) -> None:
    """Add what white acceleration contributes to a covariance within dt."""
    position = noise_m2_s3 * dt_s**3 / 3.0
    shared = noise_m2_s3 * dt_s**2 / 2.0
    rate = noise_m2_s3 * dt_s
    for cell in _POSITION_CELLS:
        covariance[cell] += position
    for cell in _SHARED_CELLS:
        covariance[cell] += shared
    for cell in _RATE_CELLS:
        covariance[cell] += rate


class Turn(NamedTuple):
    """Integrals of a turning velocity over dt, and their slopes by the turn rate.

    Attributes:
        sine: sin ωt.
        cosine: cos ωt.
        along_s: sin(ωt)/ω: seconds that the first velocity lasts in its own direction.
        across_s: (1 − cos ωt)/ω: seconds that it lasts to its right.
        along_slope: Derivative of `along_s` by ω.
        across_slope: Derivative of `across_s` by ω.
    """

    sine: float
    cosine: float
    along_s: float
    across_s: float
    along_slope: float
    across_slope: float


class TurnJacobian(NamedTuple):
    """Derivative of the turning model's state after dt by its state before.

    Attributes:
        turn: Derivatives by the velocity.
        north: Slope of north by the turn rate.
        east: Slope of east by the turn rate.
        north_rate: Slope of the north rate by the turn rate.
        east_rate: Slope of the east rate by the turn rate.
        fade: Share of the turn rate that remains.
    """

    turn: Turn
    north: float
    east: float
    north_rate: float
    east_rate: float
    fade: float

    def transformed(self, covariance: Components) -> list[float]:
        """Return the lower triangle of J P Jᵀ for the lower triangle of P."""
        sine, cosine, along_s, across_s, _, _ = self.turn
        _, north_by_turn, east_by_turn, north_rate_by_turn, east_rate_by_turn, fade = self
        columns: Iterable[tuple[float, ...]] = [row(covariance) for row in _LAYOUTS[5].rows]
        for _ in range(2):  # the first (J P)ᵀ is P Jᵀ, as P is symmetric; the second is J P Jᵀ
            products = [
                (
                    north + along_s * north_rate - across_s * east_rate + north_by_turn * turn_rate,
                    east + across_s * north_rate + along_s * east_rate + east_by_turn * turn_rate,
                    cosine * north_rate - sine * east_rate + north_rate_by_turn * turn_rate,
                    sine * north_rate + cosine * east_rate + east_rate_by_turn * turn_rate,
                    fade * turn_rate,
                )
                for north, east, north_rate, east_rate, turn_rate in columns
            ]
            columns = zip(*products, strict=True)
        return [
            *products[0][:1],
            *products[1][:2],
            *products[2][:3],
            *products[3][:4],
            *products[4],
        ]


def turning_after(state: Normal, dt_s: float, settings: TrackSettings) -> Normal:
    """Advance the turning model by dt."""
    north, east, north_rate_before, east_rate_before, turn_rate = state.mean
    angle = turn_rate * dt_s
    sine = math.sin(angle)
    cosine = math.cos(angle)
    if abs(angle) < _SMALL_TURN_RAD:  # the limits where the turn is small
        turn = Turn(
            sine,
            cosine,
            along_s=dt_s * (1.0 - angle**2 / 6.0),
            across_s=dt_s * angle * (0.5 - angle**2 / 24.0),
            along_slope=-(dt_s**2) * angle / 3.0,
            across_slope=dt_s**2 * (0.5 - angle**2 / 8.0),
        )
    else:
        along_s = sine / turn_rate
        across_s = (1.0 - cosine) / turn_rate
        along_slope = (dt_s * cosine - along_s) / turn_rate
        across_slope = (dt_s * sine - across_s) / turn_rate
        turn = Turn(sine, cosine, along_s, across_s, along_slope, across_slope)
    north_rate = turn.cosine * north_rate_before - turn.sine * east_rate_before
    east_rate = turn.sine * north_rate_before + turn.cosine * east_rate_before
    fade = math.exp(-dt_s / settings.turn_time_s)
    jacobian = TurnJacobian(
        turn,
        north=turn.along_slope * north_rate_before - turn.across_slope * east_rate_before,
        east=turn.across_slope * north_rate_before + turn.along_slope * east_rate_before,
        north_rate=-dt_s * east_rate,
        east_rate=dt_s * north_rate,
        fade=fade,
    )
    covariance = jacobian.transformed(state.covariance)
    _add_acceleration(covariance, settings.turning_noise_m2_s3, dt_s)
    covariance[-1] += settings.turn_rate_sd_rad_s**2 * (1.0 - fade**2)
    mean = (
        north + turn.along_s * north_rate_before - turn.across_s * east_rate_before,
        east + turn.across_s * north_rate_before + turn.along_s * east_rate_before,
        north_rate,
        east_rate,
        fade * turn_rate,
    )
    return Normal(mean, covariance)


def position_variance(state: Normal) -> float:
    """Return the larger of the variances north and east, m²."""
    return max(state.covariance[_cell(0, 0)], state.covariance[_cell(1, 1)])


def distance(modes: Modes, measured: Components, variances: Components) -> float:
    """Return νᵀS⁻¹ν of a report and the mixture: χ² distributed with as many degrees as there are numbers."""
    return _corrected(blended(*modes), measured, variances).distance


def correct(modes: Modes, measured: Components, variances: Components) -> Modes:
    """Correct both models with a report of position (2,), or position and velocity (4,), and its variances."""
    steady = _corrected(modes.steady, measured, variances)
    turning = _corrected(modes.turning, measured, variances)
    closer = steady.distance - turning.distance
    log_ratio = 0.5 * (closer + math.log(steady.spread / turning.spread))
    # Bayes' rule for two hypotheses, kept off 0 and 1, so that both models remain possible.
    odds = math.log(modes.turning_share / (1.0 - modes.turning_share)) + log_ratio
    probability = 0.0
    if odds > -700.0:  # exp would overflow
        probability = 1.0 / (1.0 + math.exp(-odds))
    return Modes(steady.state, turning.state, min(1.0 - 1e-9, max(1e-9, probability)))


class Correction(NamedTuple):
    """A corrected state, and how well the report fits.

    Attributes:
        state: After the report.
        distance: νᵀS⁻¹ν of the report.
        spread: det S, the spread of the expected report.
    """

    state: Normal
    distance: float
    spread: float


def _corrected(state: Normal, measured: Components, variances: Components) -> Correction:
    """Correct by one number after the other, as their errors are independent."""
    mean = state.mean
    covariance = state.covariance
    layout = _LAYOUTS[len(mean)]
    distance = 0.0
    spread = 1.0
    for index, (value, variance) in enumerate(zip(measured, variances, strict=True)):
        shared = layout.rows[index](covariance)
        expected = shared[index] + variance
        innovation = value - mean[index]
        inverse = 1.0 / expected
        gain = innovation * inverse
        distance += innovation * innovation * inverse
        spread *= expected
        mean = [number + gain * part for number, part in zip(mean, shared, strict=True)]
        cells = zip(covariance, layout.by_row(shared), layout.by_column(shared), strict=True)
        covariance = [number - inverse * (row * column) for number, row, column in cells]
    return Correction(Normal(mean, covariance), distance, spread)


def blended(first: Normal, second: Normal, share: float) -> Normal:
    """Return the mixture with this share of the second: mean and covariance of the numbers that both have."""
    remainder = 1.0 - share
    spread = remainder * share
    pairs = list(zip(first.mean, second.mean, strict=False))
    apart = [theirs - ours for ours, theirs in pairs]
    mean = [remainder * ours + share * theirs for ours, theirs in pairs]
    layout = _LAYOUTS[len(apart)]
    between = map(mul, layout.by_row(apart), layout.by_column(apart))
    cells = zip(first.covariance, second.covariance, between, strict=False)
    covariance = [
        remainder * ours + share * theirs + spread * product for ours, theirs, product in cells
    ]
    return Normal(mean, covariance)


def mean_of(modes: Modes) -> list[float]:
    """Return the mean of the mixture of both models: north, east and their rates."""
    share = modes.turning_share
    remainder = 1.0 - share
    pairs = zip(modes.steady.mean, modes.turning.mean, strict=False)
    return [remainder * steady + share * turning for steady, turning in pairs]


class Height(NamedTuple):
    """The evader's height: down (m), its rate (m/s), and the three numbers of their covariance."""

    down_m: float
    rate_m_s: float
    down_variance: float
    shared: float
    rate_variance: float


def correct_down(height: Height, measured_m: float, variance_m2: float) -> Height:
    """Correct with a measured height."""
    down, rate, variance, shared, rate_variance = height
    total = variance + variance_m2
    difference = measured_m - down
    return Height(
        down + variance / total * difference,
        rate + shared / total * difference,
        variance * variance_m2 / total,
        shared * variance_m2 / total,
        rate_variance - shared * shared / total,
    )


def correct_rate(height: Height, measured_m_s: float, variance_m2_s2: float) -> Height:
    """Correct with a measured vertical speed."""
    turned = Height(
        height.rate_m_s, height.down_m, height.rate_variance, height.shared, height.down_variance
    )
    rate, down, rate_variance, shared, variance = correct_down(turned, measured_m_s, variance_m2_s2)
    return Height(down, rate, variance, shared, rate_variance)


class Estimate(NamedTuple):
    """The evader at a time of our clock, in the plane and in height, and the arrival of its last report."""

    time_s: float
    received_s: float
    modes: Modes
    height: Height


def advance(estimate: Estimate, time_s: float, settings: TrackSettings) -> Estimate:
    """Mix both models and advance them to a later time, and the height at a constant rate with white acceleration.

    For an earlier time return the estimate unchanged.
    """
    dt_s = time_s - estimate.time_s
    if dt_s <= 0.0:
        return estimate
    # Mix both models by the chances that a turn has begun or ended within dt.
    begins_per_s = 1.0 / settings.steady_time_s
    ends_per_s = 1.0 / settings.turning_time_s
    switching_per_s = begins_per_s + ends_per_s
    settled_s = -math.expm1(-switching_per_s * dt_s) / switching_per_s
    steady, turning, turning_before = estimate.modes
    still_turning = turning_before * (1.0 - ends_per_s * settled_s)
    turning_share = (1.0 - turning_before) * begins_per_s * settled_s + still_turning
    turned_steady = turning_before * ends_per_s * settled_s / (1.0 - turning_share)
    # The steady model takes the turn rate of the other, since it has none of its own.
    as_turning = Normal(
        (*steady.mean, turning.mean[-1]),
        (*steady.covariance, 0.0, 0.0, 0.0, 0.0, turning.covariance[-1]),
    )
    mixed_turning = blended(as_turning, turning, still_turning / turning_share)
    modes = Modes(
        steady_after(blended(steady, turning, turned_steady), dt_s, settings),
        turning_after(mixed_turning, dt_s, settings),
        turning_share,
    )
    before = estimate.height
    noise = settings.height_noise_m2_s3
    grown = before.down_variance + 2.0 * dt_s * before.shared + dt_s**2 * before.rate_variance
    height = Height(
        before.down_m + before.rate_m_s * dt_s,
        before.rate_m_s,
        grown + noise * dt_s**3 / 3.0,
        before.shared + dt_s * before.rate_variance + noise * dt_s**2 / 2.0,
        before.rate_variance + noise * dt_s,
    )
    return Estimate(time_s, estimate.received_s, modes, height)


class EvaderEstimate(NamedTuple):
    """The evader at a time of our clock, extrapolated from its last report.

    Attributes:
        position_ned_m: Position in the local frame.
        velocity_ned_m_s: Velocity; zero while neither reports nor motion have determined it.
        speed_bound_m_s: max(declared, estimate + kσ) over the ground.
        age_s: Time since the last report was true: τ of the game's l − uτ.
    """

    position_ned_m: Ned
    velocity_ned_m_s: Ned
    speed_bound_m_s: float
    age_s: float


def predict(
    last: Estimate, shift_ned_m: Ned, now_s: float, settings: TrackSettings
) -> EvaderEstimate:
    """Return the evader at a time of our clock, not before its last report.

    Args:
        last: The estimate after its last report.
        shift_ned_m: Position of the track's frame in the local frame.
        now_s: The time.
        settings: Noise and bounds of the track.
    """
    moved = advance(last, now_s, settings)
    mixture = blended(*moved.modes)
    north, east, north_rate, east_rate = mixture.mean
    covariance = PlaneCovariance(*mixture.covariance)
    north_variance = covariance.north_rate_north_rate
    east_variance = covariance.east_rate_east_rate
    shared = covariance.east_rate_north_rate
    # σ of the velocity in its worst direction, from the larger eigenvalue.
    worst_variance = 0.5 * (north_variance + east_variance) + math.hypot(
        0.5 * (north_variance - east_variance), shared
    )
    worst_sd = math.sqrt(max(0.0, worst_variance))
    # σ of the speed.
    speed_m_s = math.hypot(north_rate, east_rate)
    speed_sd = worst_sd
    if speed_m_s > worst_sd:  # there is a direction
        to_north = north_rate / speed_m_s
        to_east = east_rate / speed_m_s
        speed_variance = (
            to_north * to_north * north_variance
            + 2.0 * to_north * to_east * shared
            + to_east * to_east * east_variance
        )
        speed_sd = math.sqrt(max(0.0, speed_variance))
    velocity = STILL
    if worst_sd <= settings.known_velocity_sd_m_s:
        velocity = Ned((north_rate, east_rate, moved.height.rate_m_s))
    return EvaderEstimate(
        Ned((north, east, moved.height.down_m)) + shift_ned_m,
        velocity,
        max(settings.declared_speed_m_s, speed_m_s + settings.sigmas * speed_sd),
        max(0.0, now_s - last.time_s),
    )
