"""``python -m ibrpipe``."""

from ibrpipe.cli.main import main

main()
