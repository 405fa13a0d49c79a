"""How flights and games are drawn: the shapes, which anything can draw, and the figures, which need matplotlib.

`shapes` knows arrays only, so that a live view imports no matplotlib; `figures` is the one place that does.
"""
