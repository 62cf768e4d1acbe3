"""Speed against error, renderers and baselines in one run."""
