"""What makes a vehicle fly what the game asks for: drift ▸ catching up ▸ approach ▸ servo, and standing still."""

from guidance.following.boundary import keep_inside
from guidance.following.follow import Following, FollowMemory, Motion, follow, less_drift, with_drift
from guidance.following.handling import HANDLING, Handling, handling
from guidance.following.station import NorthEast, keep_station

__all__ = [
    "HANDLING",
    "FollowMemory",
    "Following",
    "Handling",
    "Motion",
    "NorthEast",
    "follow",
    "handling",
    "keep_inside",
    "keep_station",
    "less_drift",
    "with_drift",
]
