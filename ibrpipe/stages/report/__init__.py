"""The report: one HTML page that holds everything it shows."""

from ibrpipe.stages.report.page import write_report
from ibrpipe.stages.report.pictures import ViewPictures, draw_view
from ibrpipe.stages.report.sources import ReportSources, read_sources

__all__ = ["ReportSources", "ViewPictures", "draw_view", "read_sources", "write_report"]
