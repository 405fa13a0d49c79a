"""Team flight: messages between vehicles, election, assignment of evaders. No I/O and no clock.

Member: one vehicle's part. It hears the mates, publishes the vehicle, and gives each cycle its mates and its role.
Board: the knowledge of a vehicle about its mates, assignments and evaders.
Coordinator: the election, and the assignment of vehicles to evaders by `guidance.game.team.match_teams`.
Transport: carries the bytes. `MemoryNetwork` is one in virtual time, with delay and loss.
"""

from guidance.team.board import Board
from guidance.team.coordinator import Coordinator
from guidance.team.member import Member
from guidance.team.transport import MemoryNetwork, Transport

__all__ = ["Board", "Coordinator", "Member", "MemoryNetwork", "Transport"]
