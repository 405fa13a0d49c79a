"""Team flight: messages between vehicles, election, assignment of evaders. No I/O and no clock.

Member: one vehicle's part. It hears the mates, publishes the vehicle, and gives each cycle its mates and its role.
Transport: carries the bytes. `MemoryTransport` is one in virtual time.

`guidance.team.board` is the knowledge of a vehicle about its mates. `guidance.team.coordinator` has the election and
the assignment of vehicles to evaders by `guidance.game.team.match_teams`.
"""

from guidance.team.member import Member
from guidance.team.messages import MemoryTransport, Transport

__all__ = ["Member", "MemoryTransport", "Transport"]
