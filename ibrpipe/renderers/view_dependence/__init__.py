"""Adding what changes with the view direction to a frame, a file a kind of component."""
