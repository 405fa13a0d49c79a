"""A flight as one page: pictures and a summary of its record."""

from guidance.viz.report.page import PICTURES, write_report
from guidance.viz.report.story import Story, story_of
from guidance.viz.report.summary import summary

__all__ = ["PICTURES", "Story", "story_of", "summary", "write_report"]
