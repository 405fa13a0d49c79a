"""The viewer (Rerun), live or from a record. Needs the extra `viz`.

view: shows a `FlightSource`, for example a `RecordFile`, at a `Destination`.
ViewerBeside: runs the viewer in a child process.
"""

from guidance.viz.subprocesses import ViewerBeside
from guidance.viz.view.command import Destination, FlightSource, RecordFile, view

__all__ = ["Destination", "FlightSource", "RecordFile", "ViewerBeside", "view"]
