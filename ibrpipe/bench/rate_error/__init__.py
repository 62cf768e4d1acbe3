"""Bytes against error: one asset in many codings, held against its held-out photos."""
