"""Path to arrays and back: images, cameras, captures, meshes, layers, assets, manifests."""
