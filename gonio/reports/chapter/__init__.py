"""The textbook's chapter on radiometry and reflection as small computed experiments, on one page."""

from gonio.reports.chapter.build import chapter as chapter
