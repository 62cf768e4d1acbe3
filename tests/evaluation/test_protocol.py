"""What the report says of how it measured."""

from __future__ import annotations

from ibrpipe.evaluation.protocol import make_protocol
from ibrpipe.types import Camera


def test_factors_taken_from_held_out_photos_are_told() -> None:
    camera = Camera.look_at((0, 0, -3), (0, 0, 1), up=(0, -1, 0), fov_y_deg=60, width=64, height=48)
    plain = make_protocol(camera, 3, 2, 24, 1).lines
    balanced = make_protocol(camera, 3, 2, 24, 1, "they disagree by 0.1 stops").lines
    (more,) = [line for line in balanced if line not in plain]
    assert "they disagree by 0.1 stops. Held-out photos, too" in more
    assert "these three factors a photo are all that was taken from them" in more
    assert len(balanced) == len(plain) + 1
