"""Drawings of flights and games: shapes as arrays, and figures with matplotlib.

`figures` and `report` import matplotlib; `view` and `panel` do not, so that a live view starts quickly.
"""
