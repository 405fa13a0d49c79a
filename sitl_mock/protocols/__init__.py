"""MAVLink's protocols as objects without I/O: a message and the time in, replies out."""

from sitl_mock.protocols.command import (
    PX4_BROADCAST,
    Command,
    CommandAnswer,
    CommandProtocol,
    Result,
    coordinate,
    read_command,
)
from sitl_mock.protocols.events import EventLog, EventProtocol
from sitl_mock.protocols.ftp import Entry, Files, FtpError, FtpProtocol
from sitl_mock.protocols.home import HomeProtocol, Place, gps_global_origin, home_position, on_earth
from sitl_mock.protocols.identity import (
    ARDUPILOT_CAPABILITIES,
    PX4_CAPABILITIES,
    Capability,
    Identity,
    ardupilot_identity,
    px4_identity,
)
from sitl_mock.protocols.logs import LogProtocol
from sitl_mock.protocols.mission import MissionProtocol
from sitl_mock.protocols.mission_rules import ARDUPILOT_MISSION_RULES, PX4_MISSION_RULES, MissionRules
from sitl_mock.protocols.parameter import Parameter, ParameterError, ParameterStore, ParamKind
from sitl_mock.protocols.parameter_protocol import (
    ARDUPILOT_PARAMETER_RULES,
    PX4_PARAMETER_RULES,
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
from sitl_mock.protocols.reply import LatePiece, Piece, Reply, addressed, source_of
from sitl_mock.protocols.session import MESSAGES, PX4_OWN_ID_ONLY, Session
from sitl_mock.protocols.signing_setup import SigningSetup
from sitl_mock.protocols.standard_modes import (
    ModeEntry,
    StandardMode,
    available_modes,
    available_modes_monitor,
    current_mode,
)
from sitl_mock.protocols.statustext import StatusTexts
from sitl_mock.protocols.streams import StreamRules, Streams
from sitl_mock.protocols.timesync import TimeProtocol

__all__ = [
    "ARDUPILOT_CAPABILITIES",
    "ARDUPILOT_HZ",
    "ARDUPILOT_MISSION_RULES",
    "ARDUPILOT_PARAMETER_RULES",
    "ARDUPILOT_STREAM_RULES",
    "MESSAGES",
    "PX4_BROADCAST",
    "PX4_CAPABILITIES",
    "PX4_GCS_HZ",
    "PX4_MISSION_RULES",
    "PX4_ONBOARD_HZ",
    "PX4_OWN_ID_ONLY",
    "PX4_PARAMETER_RULES",
    "PX4_STREAM_RULES",
    "Capability",
    "Command",
    "CommandAnswer",
    "CommandProtocol",
    "Entry",
    "EventLog",
    "EventProtocol",
    "Files",
    "FtpError",
    "FtpProtocol",
    "HomeProtocol",
    "Identity",
    "LatePiece",
    "LogProtocol",
    "MissionProtocol",
    "MissionResult",
    "MissionRules",
    "ModeEntry",
    "ParamKind",
    "Parameter",
    "ParameterError",
    "ParameterProtocol",
    "ParameterRules",
    "ParameterStore",
    "Piece",
    "Place",
    "Plan",
    "PlanItem",
    "PlanKind",
    "PlanStore",
    "Reply",
    "Result",
    "Session",
    "SigningSetup",
    "StandardMode",
    "StatusTexts",
    "StreamRules",
    "Streams",
    "TimeProtocol",
    "addressed",
    "ardupilot_identity",
    "available_modes",
    "available_modes_monitor",
    "coordinate",
    "current_mode",
    "gps_global_origin",
    "home_position",
    "on_earth",
    "px4_identity",
    "read_command",
    "source_of",
]
