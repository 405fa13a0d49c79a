"""A flight to look at, live or from its record, in a process of its own. Needs the extra `viz`.

What it offers:
    view: shows a `FlightSource`, of which `RecordFile` is one, at a `Destination`.
    ViewerBeside: does so in a process beside a flight.
"""

from guidance.viz.subprocesses import ViewerBeside
from guidance.viz.view.command import Destination, FlightSource, RecordFile, view

__all__ = ["Destination", "FlightSource", "RecordFile", "ViewerBeside", "view"]
