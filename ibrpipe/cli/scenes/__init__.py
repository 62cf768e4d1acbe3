"""Commands of scenes."""
