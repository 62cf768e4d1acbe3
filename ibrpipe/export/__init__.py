"""Assets in forms that other programs open: an exporter a module, known by name."""
