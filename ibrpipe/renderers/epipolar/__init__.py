"""The `epipolar` renderer: inverse warping along whole epipolar lines (schaufler1999)."""
