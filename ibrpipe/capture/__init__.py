"""Photo sets of a capture: reading, auditing, and what sees what."""
