"""From photos with cameras to a surface: depth maps, their fusion, and the mesh."""
