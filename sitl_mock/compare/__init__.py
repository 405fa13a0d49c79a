"""`sitl-mock compare`: a recorded flight's messages beside the mock's under the same client."""

from sitl_mock.compare.behaviour import Behaviour, Field, Stream, behaviour_of
from sitl_mock.compare.difference import Difference, differences
from sitl_mock.compare.flight import BOOTED_S, fly_recording
from sitl_mock.compare.tlog import Recording, read_tlog

__all__ = [
    "BOOTED_S",
    "Behaviour",
    "Difference",
    "Field",
    "Recording",
    "Stream",
    "behaviour_of",
    "differences",
    "fly_recording",
    "read_tlog",
]
