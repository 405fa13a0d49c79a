"""`sitl-mock compare`: a recorded flight's messages beside the mock's under the same client."""

from sitl_mock.compare.behaviour import (
    Behaviour,
    FieldRange,
    MessageDifference,
    Stream,
    behaviour_of,
    differences,
)
from sitl_mock.compare.recording import BOOTED_S, Recording, fly_recording, read_tlog

__all__ = [
    "BOOTED_S",
    "Behaviour",
    "FieldRange",
    "MessageDifference",
    "Recording",
    "Stream",
    "behaviour_of",
    "differences",
    "fly_recording",
    "read_tlog",
]
