"""A battery that is drained by flying, to half as in PX4's simulation, or is put where a test wants it."""

from dataclasses import dataclass

_FULL_V, _EMPTY_V = 4.05, 3.6
_CELLS = 4
LEAST = 0.5
"""Flying does not drain it further (SIM_BAT_MIN_PCT), so that long tests do not end in failsafes."""


@dataclass(slots=True)
class Battery:
    """State of charge.

    Attributes:
        remaining: Fraction in [0, 1].
        current_a: Present current.
        consumed_mah: Charge taken since start.
        capacity_mah: Full charge.
    """

    remaining: float = 1.0
    current_a: float = 0.0
    consumed_mah: float = 0.0
    capacity_mah: float = 5000.0

    def advance(self, dt_s: float, thrust_share: float) -> None:
        """Drain for dt_s at a share of hover thrust (0: motors off)."""
        self.current_a = 0.4 + 14.0 * thrust_share
        used_mah = self.current_a * dt_s / 3.6
        self.consumed_mah += used_mah
        if self.remaining > LEAST:
            self.remaining = max(LEAST, self.remaining - used_mah / self.capacity_mah)

    @property
    def voltage_v(self) -> float:
        """Voltage of the pack."""
        return _CELLS * (_EMPTY_V + (_FULL_V - _EMPTY_V) * self.remaining)

    @property
    def cell_v(self) -> float:
        """Voltage of one cell."""
        return self.voltage_v / _CELLS

    @property
    def cells(self) -> int:
        """Cells in series."""
        return _CELLS
