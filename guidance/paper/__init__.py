"""The published numbers and figures of Li, Wang & Xie, computed again.

What it offers:
    tables: both tables of section V, a `Table` each; a `Case` is one published number beside ours.

`guidance.paper.figures` draws the figures; it is imported apart, since it brings matplotlib with it.
"""

from guidance.paper.cases import Case, Table, tables

__all__ = ["Case", "Table", "tables"]
