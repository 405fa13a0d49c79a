"""The panel: shows daemons in a browser and sends them orders. A separate process; needs the extra `panel`.

Contents:
    serve_panel: serves the page, by `PanelOptions`. PanelBeside: does so in a child process of a flight.
"""

from guidance.viz.panel.command import PanelOptions, serve_panel
from guidance.viz.subprocesses import PanelBeside

__all__ = ["PanelBeside", "PanelOptions", "serve_panel"]
