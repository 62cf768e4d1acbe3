"""Video files: their frames in, pictures out."""
