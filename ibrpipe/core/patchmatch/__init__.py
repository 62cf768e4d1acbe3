"""PatchMatch stereo with slanted planes."""
