"""Fitting what changes with the view direction, a file a kind of component."""
