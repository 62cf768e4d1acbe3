"""Casting whole epipolar lines through height fields and layered images (schaufler1999)."""
