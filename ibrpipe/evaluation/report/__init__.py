"""The report: one HTML page that holds everything it shows."""

from ibrpipe.evaluation.report.page import write_report
from ibrpipe.evaluation.report.pictures import ViewPictures
from ibrpipe.evaluation.report.sources import ReportSources, read_sources

__all__ = ["ReportSources", "ViewPictures", "read_sources", "write_report"]
