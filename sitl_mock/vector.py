"""Vectors of the mock: three numbers along north, east and down, or along a body's forward, right and down.

The mock is an independent witness, so it has a type of its own.
"""

import math
from typing import Final


class Vector(tuple[float, float, float]):
    """Three numbers, the third vertical: `Vector((north, east, down))`. NaN marks an axis that is not given."""

    __slots__ = ()

    def __add__(self, other: "Vector") -> "Vector":  # type: ignore[override] # tuples would be joined
        (x, y, z) = self
        (other_x, other_y, other_z) = other
        return Vector((x + other_x, y + other_y, z + other_z))

    def __sub__(self, other: "Vector") -> "Vector":
        (x, y, z) = self
        (other_x, other_y, other_z) = other
        return Vector((x - other_x, y - other_y, z - other_z))

    def __mul__(self, factor: float) -> "Vector":  # type: ignore[override] # a tuple would be repeated
        (x, y, z) = self
        return Vector((x * factor, y * factor, z * factor))

    __rmul__ = __mul__  # type: ignore[assignment]

    def __truediv__(self, divisor: float) -> "Vector":
        (x, y, z) = self
        return Vector((x / divisor, y / divisor, z / divisor))

    def after(self, rate_per_s: "Vector", dt_s: float) -> "Vector":
        """Return the vector after a time in which it changes at a constant rate."""
        (x, y, z) = self
        (x_per_s, y_per_s, z_per_s) = rate_per_s
        return Vector((x + x_per_s * dt_s, y + y_per_s * dt_s, z + z_per_s * dt_s))

    def moved(self, velocity: "Vector", acceleration: "Vector", dt_s: float) -> "Vector":
        """Return the position after a time of constant acceleration that begins with a velocity."""
        (x, y, z) = self
        (v_x, v_y, v_z) = velocity
        (a_x, a_y, a_z) = acceleration
        half_s = 0.5 * dt_s
        return Vector(
            (
                x + (v_x + a_x * half_s) * dt_s,
                y + (v_y + a_y * half_s) * dt_s,
                z + (v_z + a_z * half_s) * dt_s,
            )
        )

    def scaled(self, factors: "Vector") -> "Vector":
        """Return the vector with each number times a factor of its own."""
        (x, y, z) = self
        (x_factor, y_factor, z_factor) = factors
        return Vector((x * x_factor, y * y_factor, z * z_factor))

    def level_length(self) -> float:
        """Return the length of the level part."""
        return math.hypot(self[0], self[1])

    def level_with(self, down: float) -> "Vector":
        """Return the vector with the same level part and another vertical number."""
        return Vector((self[0], self[1], down))


ZERO: Final = Vector((0.0, 0.0, 0.0))
UNSET: Final = Vector((math.nan, math.nan, math.nan))
"""No axis is given."""
