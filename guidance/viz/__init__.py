"""Drawings of flights and games: shapes as arrays, and figures with matplotlib.

`shapes` knows arrays only, so that a live view imports no matplotlib; `figures` is the one place that does.
"""
