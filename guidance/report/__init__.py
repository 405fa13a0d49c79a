"""A flight as one page: pictures and a summary of its record."""

from guidance.report.page import PICTURES, write_report
from guidance.report.story import Story, story_of
from guidance.report.summary import summary

__all__ = ["PICTURES", "Story", "story_of", "summary", "write_report"]
