"""The pages of the bench: HTML that holds everything it shows and loads nothing."""

from ibrpipe.bench.report.hard_page import write_hard_page
from ibrpipe.bench.report.rate_page import write_rate_page
from ibrpipe.bench.report.size_pages import write_growth_page, write_table2_page
from ibrpipe.bench.report.speed_page import write_speed_page

__all__ = ["write_growth_page", "write_hard_page", "write_rate_page", "write_speed_page", "write_table2_page"]
