"""Photo files: pixels, colour spaces, orientation, exposure, masks."""
