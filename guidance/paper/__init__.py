"""The published numbers and figures of Li, Wang & Xie, computed again.

Contents:
    tables: both tables of section V, a `Table` each; a `Case` is one published number beside ours.

`guidance.paper.figures` draws the figures; it is a separate import because it needs matplotlib.
"""

from guidance.paper.cases import Case, Table, tables

__all__ = ["Case", "Table", "tables"]
