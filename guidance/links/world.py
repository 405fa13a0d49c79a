"""The world of a flight: its vehicles and evaders, by name."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

from guidance.frames import Enu
from guidance.links.mavlink.ground_link import GroundLink
from guidance.links.port import EvaderSource, VehicleLink
from guidance.links.wires.base import CapturedFrame, TappedWire


class EvaderPlayer(Protocol):
    """An evader that this process plays itself."""

    ready: bool
    """True if it can begin to play."""

    position_game_m: Enu | None
    """Its position in the game frame, None until it knows."""

    def step(self, now_s: float, pursuers_game_m: Sequence[Enu], *, playing: bool) -> None:
        """Move on to the present, playing against these pursuers or standing still."""

    def stop(self) -> None:
        """The flight is over: disarm."""


@dataclass(slots=True)
class World:
    """All vehicles and evaders of a flight, by name. This one's time is real, and its vehicles fly somewhere else.

    Attributes:
        links: The vehicles.
        evaders: Sources of evader reports: by the vehicle's name, then by the evader's name.
        taps: Pass on the raw frames of the vehicles' wires.
        closing: Closes everything.
        players: The evaders that this process plays.
        ground_links: To the ground stations of vehicles whose files ask for that.
    """

    links: dict[str, VehicleLink] = field(default_factory=dict)
    evaders: dict[str, Mapping[str, EvaderSource]] = field(default_factory=dict)
    taps: list[TappedWire] = field(default_factory=list)
    closing: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)
    players: dict[str, EvaderPlayer] = field(default_factory=dict)
    ground_links: dict[str, GroundLink] = field(default_factory=dict)
    real_time: ClassVar[bool] = True

    def advance(self) -> None:
        """Bring the world up to the clock's present.

        Raises:
            LinkError: If the world has ended: the mock autopilot died, say.
        """

    def engage(self, _vehicle: str) -> None:
        """A vehicle's game has begun: start the faults that count from its engagement, where the vehicle is a mock."""

    def drain(self) -> Sequence[CapturedFrame]:
        """Return the raw frames that passed since the last call, of one vehicle after the other, for the records."""
        return [passed for tap in self.taps for passed in tap.drain()]

    def close(self) -> None:
        """End everything this world has started; may be called twice."""
        self.closing.close()
