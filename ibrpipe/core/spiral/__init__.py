"""Spiral directions and the view-dependent residuals sampled along them (gong-yang, sec. 3 and 4)."""
