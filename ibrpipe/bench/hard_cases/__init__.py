"""Hard cases of numerical stability: every renderer against an exact oracle."""
