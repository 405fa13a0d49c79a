"""The operator's page: daemons seen and ordered in a browser, from a process of its own. Needs the extra `panel`.

What it offers:
    serve_panel: serves the page as `PanelOptions` say. PanelBeside: does so in a process beside a flight.
"""

from guidance.viz.panel.command import PanelOptions, serve_panel
from guidance.viz.subprocesses import PanelBeside

__all__ = ["PanelBeside", "PanelOptions", "serve_panel"]
