"""``ibrpipe relief``: relief textures, and reliefs mapped onto meshes."""
