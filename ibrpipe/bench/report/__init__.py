"""The pages of the bench: HTML that holds everything it shows and loads nothing."""

from ibrpipe.bench.report.hard_page import write_hard_page
from ibrpipe.bench.report.speed_page import write_speed_page

__all__ = ["write_hard_page", "write_speed_page"]
