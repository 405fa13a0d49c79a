"""A flight to look at, live or from its record, in a process of its own. Needs the extra `viz`."""

from guidance.view.beside import ViewerBeside
from guidance.view.command import Destination, Seen, view

__all__ = ["Destination", "Seen", "ViewerBeside", "view"]
