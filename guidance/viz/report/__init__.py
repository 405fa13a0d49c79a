"""The report: one HTML page with pictures and a summary of a record.

Contents:
    write_report: writes the page and its PICTURES.
    story_of: reads a record into a `Story`, arrays over its cycles; `summary` makes its table.
"""

from guidance.viz.report.page import PICTURES, write_report
from guidance.viz.report.story import Story, story_of, summary

__all__ = ["PICTURES", "Story", "story_of", "summary", "write_report"]
