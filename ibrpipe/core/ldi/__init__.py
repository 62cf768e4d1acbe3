"""Exact ray search in layered depth images and height fields, and the colours of hits (gong-yang, sec. 5)."""
