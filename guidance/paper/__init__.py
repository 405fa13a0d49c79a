"""The published numbers and figures of Li, Wang & Xie, computed again."""

from guidance.paper.cases import Case, Table, tables

__all__ = ["Case", "Table", "tables"]
