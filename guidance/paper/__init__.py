"""The published numbers and figures of Li, Wang & Xie, computed again."""

from guidance.paper.cases import Case, Table, tables
from guidance.paper.figures import draw_figures

__all__ = ["Case", "Table", "draw_figures", "tables"]
