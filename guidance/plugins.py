"""The interface for packages from outside: an object goes into an entry point group, and files then know its name.

| group | object | names |
|---|---|---|
| `pursuit_guidance.evader_sources` | `EvaderKind` | `evader.kind` |
| `pursuit_guidance.links` | `LinkKind` | `vehicle.link` |
| `pursuit_guidance.autopilots` | `Autopilot` | `vehicle.autopilot`, scenarios, `--autopilot` |
| `pursuit_guidance.speed_sets` | a subclass of `SpeedSet` | `speed_set` of games and players |
| `pursuit_guidance.outputs` | a function of an `OutputOrder` that returns a `Sink` or None | every flight |
| `pursuit_guidance.sections` | a subclass of `Section` | a section of vehicle files |

A policy is no entry point: `policy = "module:function"` names it (`guidance.strategies.own`). A package is
imported when a file uses its name; outputs are opened by every flight, and an optional one has a section
of its own and returns None if `order.config.section(ItsSection)` is None.
"""

from guidance import messages
from guidance.autopilots import Autopilot, Bound, Finding, Mode, Preflight, Verdict, Version, Wants
from guidance.autopilots.arducopter import ARDUCOPTER
from guidance.autopilots.px4 import PX4
from guidance.config import Section
from guidance.errors import ConfigError, FlightError, GuidanceError, LinkError, OutputError
from guidance.frames import Amsl, Ellipsoid, Enu, LocalFrame, Ned
from guidance.game.speed_sets import Ball, Cylinder, Planar, Short, SpeedSet
from guidance.links import Clock, Endpoint, EvaderSource, VehicleLink, Wire, parse
from guidance.links.evaders.kinds import EvaderKind, SourceOrder
from guidance.links.kinds import LinkKind, LinkOrder
from guidance.log.entries import CycleEntry, EventEntry
from guidance.log.sink import AnsweredOrder, FlightIdentity, Report, Sink
from guidance.messages import UNKNOWN_VELOCITY, AltitudeSaid, Datum, EvaderReport
from guidance.session.observe.outputs import OutputOrder
from guidance.session.vehicle_file import Config
from guidance.vehicle import is_plausible

__all__ = [
    "ARDUCOPTER",
    "PX4",
    "UNKNOWN_VELOCITY",
    "AltitudeSaid",
    "Amsl",
    "AnsweredOrder",
    "Autopilot",
    "Ball",
    "Bound",
    "Clock",
    "Config",
    "ConfigError",
    "CycleEntry",
    "Cylinder",
    "Datum",
    "Ellipsoid",
    "Endpoint",
    "Enu",
    "EvaderKind",
    "EvaderReport",
    "EvaderSource",
    "EventEntry",
    "Finding",
    "FlightError",
    "FlightIdentity",
    "GuidanceError",
    "LinkError",
    "LinkKind",
    "LinkOrder",
    "LocalFrame",
    "Mode",
    "Ned",
    "OutputError",
    "OutputOrder",
    "Planar",
    "Preflight",
    "Report",
    "Section",
    "Short",
    "Sink",
    "SourceOrder",
    "SpeedSet",
    "VehicleLink",
    "Verdict",
    "Version",
    "Wants",
    "Wire",
    "is_plausible",
    "messages",
    "parse",
]
