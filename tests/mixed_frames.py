"""Mistakes with frames that mypy must reject; `python -m tests types` checks them. Nothing here runs.

Each line has the error that it must have. If mypy accepts the line, `warn_unused_ignores` makes its comment an error.
"""

# mypy: warn-unused-ignores, enable-error-code="arg-type,operator,return-value,assignment"

from guidance.frames import Enu, GameFrame, Ned
from guidance.messages import Setpoint
from sitl_mock import dynamics
from sitl_mock.vector import Vector


def mistakes(place_ned_m: Ned, place_game_m: Enu, frame: GameFrame) -> list[object]:
    """Return what nobody may write."""
    return [
        place_ned_m + place_game_m,  # type: ignore[operator]
        place_game_m - place_ned_m,  # type: ignore[operator]
        place_ned_m.dot(place_game_m),  # type: ignore[arg-type]
        place_ned_m * place_ned_m,  # type: ignore[operator]
        Setpoint(place_game_m),  # type: ignore[arg-type]
        Setpoint((1.0, 0.0, 0.0)),  # type: ignore[arg-type]
        frame.position_to_ned(place_ned_m),  # type: ignore[arg-type]
        frame.position_from_ned(place_game_m),  # type: ignore[arg-type]
    ]


def mistakes_of_the_mock(place_m: Vector, place_ned_m: Ned) -> list[object]:
    """Return what nobody may write in the mock, whose vectors are its own."""
    return [
        place_m + place_ned_m,  # type: ignore[operator]
        place_m - (1.0, 0.0, 0.0),  # type: ignore[operator]
        place_m * place_m,  # type: ignore[operator]
        place_m.after((1.0, 0.0, 0.0), 0.1),  # type: ignore[arg-type]
        dynamics.Setpoint(dynamics.Kind.STREAM, (1.0, 0.0, 0.0)),  # type: ignore[arg-type]
        dynamics.Setpoint(dynamics.Kind.STREAM, place_ned_m),  # type: ignore[arg-type]
        Setpoint(place_m),  # type: ignore[arg-type]
    ]
