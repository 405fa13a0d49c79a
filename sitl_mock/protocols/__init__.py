"""MAVLink's protocols as objects without I/O: a message and the time in, replies out."""

from sitl_mock.protocols.command import Command, CommandAnswer, CommandProtocol, Result, coordinate, read_command
from sitl_mock.protocols.parameter import Parameter, ParameterError, ParameterStore, ParamKind
from sitl_mock.protocols.parameter_protocol import (
    ARDUPILOT_PARAMETER_RULES,
    PX4_PARAMETER_RULES,
    ParamError,
    ParameterProtocol,
    ParameterRules,
)
from sitl_mock.protocols.rates import (
    ARDUPILOT_HZ,
    ARDUPILOT_STREAM_RULES,
    PX4_GCS_HZ,
    PX4_ONBOARD_HZ,
    PX4_STREAM_RULES,
)
from sitl_mock.protocols.reply import Piece, Reply, addressed, source_of
from sitl_mock.protocols.streams import StreamRules, Streams

__all__ = [
    "ARDUPILOT_HZ",
    "ARDUPILOT_PARAMETER_RULES",
    "ARDUPILOT_STREAM_RULES",
    "PX4_GCS_HZ",
    "PX4_ONBOARD_HZ",
    "PX4_PARAMETER_RULES",
    "PX4_STREAM_RULES",
    "Command",
    "CommandAnswer",
    "CommandProtocol",
    "ParamError",
    "ParamKind",
    "Parameter",
    "ParameterError",
    "ParameterProtocol",
    "ParameterRules",
    "ParameterStore",
    "Piece",
    "Reply",
    "Result",
    "StreamRules",
    "Streams",
    "addressed",
    "coordinate",
    "read_command",
    "source_of",
]
