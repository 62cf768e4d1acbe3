"""Shared reflection: one diffuse colour a texel and tables of reflected light for the whole object, fitted at once."""
