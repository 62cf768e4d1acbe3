"""One-dimensional pre-warp of relief textures, and the planar texture mapping behind it (oliveira2000)."""
