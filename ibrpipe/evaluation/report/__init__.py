"""The report: one HTML page that holds everything it shows."""

from ibrpipe.evaluation.report.page import write_report
from ibrpipe.evaluation.report.pictures import ViewPictures
from ibrpipe.evaluation.report.sources import ReportSources, read_sources
from ibrpipe.evaluation.report.turntable import Turntable

__all__ = ["ReportSources", "Turntable", "ViewPictures", "read_sources", "write_report"]
