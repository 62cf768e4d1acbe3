"""The `prewarp` renderer: 1-D pre-warp of relief textures (oliveira2000)."""
