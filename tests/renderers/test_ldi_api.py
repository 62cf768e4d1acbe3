"""`prepare`, `render` and `renderers`: what they refuse, and how."""

from __future__ import annotations

import numpy as np
import pytest

import ibrpipe
from ibrpipe.errors import RendererError
from ibrpipe.renderers.ldi.progressive import render_progressive

FRAME = ibrpipe.ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
SOURCE = ibrpipe.ReliefTexture(FRAME, np.full((4, 5, 3), 0.5), np.zeros((4, 5)))
CAMERA = ibrpipe.Camera.look_at((2, 2, 6), (2.5, 2, 0), width=16, height=12)


def test_registry_says_what_there_is():
    known = ibrpipe.renderers()
    assert "ReliefTexture" in known["ldi"]["accepts"]
    assert set(known["ldi"]["options"]) == {"residuals", "samples", "search", "threads"}


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ibrpipe.render(SOURCE, CAMERA, renderer="ldl"), "unknown renderer 'ldl'.*ldi"),
        (
            lambda: ibrpipe.render(SOURCE, CAMERA, residual=True),
            "no option 'residual'.*residuals, samples, search, threads",
        ),
        (lambda: ibrpipe.render(SOURCE, CAMERA, outputs=("colour",)), "unknown output 'colour'.*color, depth, alpha"),
        (lambda: ibrpipe.render([], CAMERA), "nothing to render"),
        (lambda: ibrpipe.render("mesh.ply", CAMERA), "cannot take a str.*ReliefTexture"),
        (lambda: ibrpipe.render(SOURCE, np.eye(4)), "camera must be a Camera, got ndarray"),
        (lambda: ibrpipe.render(SOURCE, CAMERA, threads=999), "threads is 999"),
        (lambda: ibrpipe.prepare([ibrpipe.prepare(SOURCE)]), "cannot hold prepared"),
    ],
)
def test_mistakes_are_named(call, message):
    with pytest.raises(RendererError, match=message):
        call()


def test_prepared_renders_the_same_and_says_its_bytes():
    prepared = ibrpipe.prepare(SOURCE)
    assert prepared.bytes > 0
    assert ibrpipe.prepare(prepared) is prepared
    a, b = ibrpipe.render(prepared, CAMERA), ibrpipe.render(SOURCE, CAMERA)
    assert a.depth.tobytes() == b.depth.tobytes()


def test_height_field_takes_few_bytes_beyond_itself():
    source = ibrpipe.ReliefTexture(FRAME, np.zeros((256, 256, 3)), np.random.default_rng(0).random((256, 256)))
    assert ibrpipe.prepare(source).bytes <= 8 * 256 * 256


def test_progressive_without_residuals_is_one_frame():
    frames = list(render_progressive(SOURCE, CAMERA))
    assert len(frames) == 1
    np.testing.assert_array_equal(frames[0].depth, ibrpipe.render(SOURCE, CAMERA).depth)
