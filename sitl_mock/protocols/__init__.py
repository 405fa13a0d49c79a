"""MAVLink's protocols as objects without I/O: a message and the time in, replies out."""

from sitl_mock.protocols.command import Command, CommandAnswer, CommandProtocol, Result, coordinate, read_command
from sitl_mock.protocols.mission import MissionProtocol
from sitl_mock.protocols.mission_rules import ARDUPILOT_MISSION_RULES, PX4_MISSION_RULES, MissionRules
from sitl_mock.protocols.parameter import Parameter, ParameterError, ParameterStore, ParamKind
from sitl_mock.protocols.parameter_protocol import (
    ARDUPILOT_PARAMETER_RULES,
    PX4_PARAMETER_RULES,
    ParamError,
    ParameterProtocol,
    ParameterRules,
)
from sitl_mock.protocols.plan import MissionResult, Plan, PlanItem, PlanKind, PlanStore
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
    "ARDUPILOT_MISSION_RULES",
    "ARDUPILOT_PARAMETER_RULES",
    "ARDUPILOT_STREAM_RULES",
    "PX4_GCS_HZ",
    "PX4_MISSION_RULES",
    "PX4_ONBOARD_HZ",
    "PX4_PARAMETER_RULES",
    "PX4_STREAM_RULES",
    "Command",
    "CommandAnswer",
    "CommandProtocol",
    "MissionProtocol",
    "MissionResult",
    "MissionRules",
    "ParamError",
    "ParamKind",
    "Parameter",
    "ParameterError",
    "ParameterProtocol",
    "ParameterRules",
    "ParameterStore",
    "Piece",
    "Plan",
    "PlanItem",
    "PlanKind",
    "PlanStore",
    "Reply",
    "Result",
    "StreamRules",
    "Streams",
    "addressed",
    "coordinate",
    "read_command",
    "source_of",
]
