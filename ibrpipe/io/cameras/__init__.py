"""Camera files of other programs: one typed outcome for every format."""
