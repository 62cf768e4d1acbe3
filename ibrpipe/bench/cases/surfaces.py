"""Groups 4 to 6, 8 and 9: what the surface is like, its size, its bits, its frame, its values."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from ibrpipe.bench.cases.case import PLAIN, SHAPE, Case, Refusal, Shot, colors, frame_of, look, relief, rough
from ibrpipe.types import Camera, DepthImage, LayeredDepthImage, ParallelFrame, ReliefTexture
from ibrpipe.types.layers import offsets_of

NAN = float("nan")


def _oblique(shape: tuple[int, int], depth: float = 1.0, sign: float = 1.0) -> Camera:
    """The whole texture from an oblique place; `sign` -1 = from the side of the image plane."""
    rows, columns = shape
    reach = max(rows, columns, 4)
    target = np.array([columns / 2, rows / 2, depth])
    return look(target + reach * np.array([0.7, -0.9, 1.3 * sign]), target, 45.0)


def layered(frame: ParallelFrame | Camera, depths: list[np.ndarray], normal: float = 1.0) -> LayeredDepthImage:
    """Return layers of (H, W) depths, NaN = none, level normals (`normal` NaN = unknown)."""
    stack = np.sort(np.stack(depths), axis=0)
    there = np.isfinite(stack)
    counts = there.sum(axis=0)
    order = np.moveaxis(stack, 0, -1)[np.moveaxis(there, 0, -1)]
    paint = np.repeat(colors(counts.shape).reshape(-1, 3), counts.ravel(), axis=0)
    facing = -frame.R[2] if isinstance(frame, Camera) else -frame.f
    return LayeredDepthImage(frame, offsets_of(counts), order, paint, np.tile(normal * facing, (len(order), 1)))


def _heights(name: str, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    height, (row, column) = np.full(shape, 1.0), (shape[0] // 2, shape[1] // 2)
    if name == "spike":
        height[row, column] = 7.0
    if name == "pit":
        height[row, column] = -7.0
    if name == "spikes-everywhere":
        height[1::3, 1::3] = 4.0
    if name == "step":
        height[:, column:] = 4.0
    if name == "steep-step":
        height[:, column:] = 1e4
    if name == "holes":
        height = rough(shape)
        height[np.random.default_rng(5).random(shape) < 0.2] = NAN
    if name == "one-texel-islands":
        height[np.indices(shape).sum(axis=0) % 2 == 0] = NAN
    if name == "empty":
        height[:] = NAN
    return height


def _surface(name: str) -> Shot:
    return relief(PLAIN, _heights(name), _oblique(SHAPE))


def _sized(rows: int, columns: int) -> Shot:
    return relief(
        PLAIN, rough((rows, columns)), _oblique((rows, columns), sign=-1.0 if min(rows, columns) == 1 else 1.0)
    )


def _layers(*depths: np.ndarray, normal: float = 1.0) -> Shot:
    return Shot(layered(PLAIN, list(depths), normal), _oblique(depths[0].shape, 3.0, -1.0))


def _two_layers(step: float, normal: float = 1.0) -> Shot:
    """Two level layers one step apart, the nearer one with holes."""
    near = np.full(SHAPE, 2.0)
    near[np.random.default_rng(6).random(SHAPE) < 0.3] = NAN
    return _layers(near, np.full(SHAPE, 2.0 + step), normal=normal)


def _full() -> Shot:
    """Six layers in every texel, each rough."""
    return _layers(*(1.0 + 2.5 * k + 0.2 * rough(seed=k) for k in range(6)))


def _no_samples() -> Shot:
    none = LayeredDepthImage(PLAIN, np.zeros((3, 5), np.int64), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    return Shot(none, _oblique((3, 4), 1.0, -1.0))


def shape_cases() -> Iterator[Case]:
    """Group 4."""
    told = {
        "spike": "one texel stands out by 6 texels", "pit": "one texel lies 8 texels deep",
        "spikes-everywhere": "every ninth texel is a spike", "step": "a step of 3 texels",
        "steep-step": "a step of ten thousand texels", "constant": "a plane",
        "holes": "a fifth of the texels is transparent", "one-texel-islands": "no cell has four texels",
        "empty": "all texels are transparent",
    }  # fmt: skip
    for name, what in told.items():
        yield Case(f"surface-{name}", 4, what, partial(_surface, name))
    for rows, columns in ((1, 1), (1, 9), (9, 1), (2, 2), (5, 33), (13, 7)):
        yield Case(f"size-{columns}x{rows}", 4, f"{columns} by {rows} texels", partial(_sized, rows, columns))
        yield Case(f"size-{columns}x{rows}-layers", 4, f"{columns} by {rows} texels, as a layered image",
                   partial(_layers, rough((rows, columns))))  # fmt: skip
    yield Case("layers-empty", 4, "a layered image without samples", _no_samples)
    yield Case("layers-full", 4, "six layers in every texel", _full)
    tie = "layers closer than float32 depth can tell: either may be shown, at the right depth"
    for label, step, tied in (("8-bit", 5.0 / 255, ""), ("16-bit", 5.0 / 65535, ""), ("float32", 2.4e-7, tie)):
        yield Case(f"layers-one-{label}-step-apart", 4, f"two level layers {step:.2g} texels apart",
                   partial(_two_layers, step), colors_tie=tied)  # fmt: skip
    yield Case("layers-unknown-normals", 4, "two layers a tenth of a texel apart, normals unknown",
               partial(_two_layers, 0.1, NAN))  # fmt: skip


def _scaled(origin: float, texel: float, shape: tuple[int, int] = (16, 16)) -> Shot:
    """The rough surface with texels of `texel` units, `origin` units from the origin along each axis."""
    frame = frame_of(np.array([1.0, -1.0, 1.0]) * origin, (texel, 0, 0), (0, texel, 0), (0, 0, 1))
    target = frame.origin + texel * np.array([8, 8, 1])
    return relief(frame, texel * rough(shape), look(target + texel * np.array([5, 9, 20]), target, 40.0))


def _plain_to_horizon() -> Shot:
    """A plain of 1280 units seen from a thousandth of a unit above it."""
    frame = frame_of((0, 0, 0), (80.0, 0, 0), (0, 80.0, 0), (0, 0, 1))
    heights = np.full((16, 16), 1e-4) * np.random.default_rng(8).random((16, 16))
    return relief(frame, heights, look((41.0, 640.0, 1.1e-3), (1200.0, 640.0, -100.0), 60.0))


def _near_and_far() -> Shot:
    """A depth image whose depths run from a thousandth to a thousand units."""
    camera = Camera.look_at((0, 0, 0), (0, 1, 0), (0, 0, 1), 50.0, 16, 13)
    depth = 10.0 ** np.linspace(-3, 3, 13)[::-1, None] * np.ones((1, 16))
    source = DepthImage(camera, colors((13, 16)), depth)
    return Shot(source, look((1e-4, -1e-4, 1e-4), (0, 1, 0), 50.0))


def scale_cases() -> Iterator[Case]:
    """Group 5."""
    yield Case("far-from-origin", 5, "1e6 units from the origin, 16 units wide", partial(_scaled, 1e6, 1.0))
    yield Case("tiny", 5, "1e-6 units wide", partial(_scaled, 0.0, 1e-6 / 16))
    yield Case("huge", 5, "1e6 units wide", partial(_scaled, 0.0, 1e6 / 16))
    yield Case("far-and-small", 5, "1e6 units from the origin, a hundredth wide", partial(_scaled, 1e6, 0.01 / 16))
    yield Case("near-far-plain", 5, "depths in view from 1e-3 to 1e3 units", _plain_to_horizon)
    yield Case("near-far-depth-image", 5, "a depth image from 1e-3 to 1e3 units", _near_and_far)


def bit_cases() -> Iterator[Case]:
    """Group 6."""
    yield Case("bits-relief", 6, "a relief texture", partial(relief, PLAIN, rough(), _oblique(SHAPE)))
    tall = partial(relief, PLAIN, rough(height=20.0), look((-14, -10, 34), (7.5, 6, 6), 40.0))
    yield Case("bits-relief-tall", 6, "a relief texture, 20 texels high", tall)
    yield Case("bits-layers", 6, "three layers", lambda: _layers(*(1 + 2.5 * k + 0.2 * rough() for k in range(3))))


def frame_cases() -> Iterator[Case | Refusal]:
    """Group 8: the matrix of an instance is the frame of its texture."""
    frames = {
        "mirrored": ("a turned round", frame_of((15, 0, 0), (-1, 0, 0), (0, 1, 0), (0, 0, 1))),
        "mirrored-depth": ("f turned round", frame_of((0, 0, 2), (1, 0, 0), (0, 1, 0), (0, 0, -1))),
        "mirrored-all": ("all axes turned round", frame_of((15, 12, 2), (-1, 0, 0), (0, -1, 0), (0, 0, -1))),
        "skewed-10-degrees": ("a and b 10 degrees apart",
                              frame_of((-4, 3, 0), (1, 0, 0), (np.cos(0.1745), np.sin(0.1745), 0), (0, 0, 1))),
        "slanted": ("f 70 degrees off the normal",
                    frame_of((0, 0, 0), (1, 0, 0), (0, 1, 0), (np.sin(1.22), 0, np.cos(1.22)))),
        "rotated": ("not along any axis",
                    frame_of((3, -2, 0), (0.8, 0.6, 0), (-0.6, 0.64, 0.48), (0.36, -0.48, 0.8))),
    }  # fmt: skip
    for name, (what, frame) in frames.items():
        yield Case(f"frame-{name}", 8, what, partial(_framed, frame))
    stretched = frame_of((0, 0, 0), (1e3, 0, 0), (0, 1, 0), (0, 0, 1))
    yield Case("frame-non-uniform", 8, "texels a thousand times as wide as high", partial(_stretched, stretched))
    refused = {
        "a-is-zero": ("edge a has no length", lambda dt: frame_of((0, 0, 0), (0, 0, 0), (0, 1, 0), (0, 0, 1), dt)),
        "b-is-zero": ("edge b has no length", lambda dt: frame_of((0, 0, 0), (1, 0, 0), (0, 0, 0), (0, 0, 1), dt)),
        "a-along-b": ("the edges are parallel", lambda dt: frame_of((0, 0, 0), (1, 1, 0), (2, 2, 0), (0, 0, 1), dt)),
        "f-in-plane": ("f lies in the plane", lambda dt: frame_of((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0), dt)),
        "f-not-unit": ("f is 2 long", lambda dt: frame_of((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 2), dt)),
        "f-is-zero": ("f has no length", lambda dt: frame_of((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 0), dt)),
        "nan": ("the origin is NaN", lambda dt: frame_of((NAN, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), dt)),
        "camera-scaled": ("a rotation that scales", lambda dt: _camera(dt, np.eye(3), 2 * np.eye(3))),
        "camera-mirrored": ("a rotation that mirrors",
                            lambda dt: _camera(dt, np.eye(3), np.diag([1, 1, -1]))),
        "camera-singular": ("a pose of rank 2", lambda dt: _camera(dt, np.eye(3), np.diag([1, 1, 0]))),
        "camera-no-focal-length": ("K with focal length 0",
                                   lambda dt: _camera(dt, np.diag([0, 1, 1]), np.eye(3))),
    }  # fmt: skip
    for name, (what, build) in refused.items():
        yield Refusal(f"refused-{name}", 8, what, build)


def _camera(dtype: str, K: np.ndarray, rotation: np.ndarray) -> Camera:
    return Camera(K.astype(dtype), np.c_[rotation, np.zeros(3)].astype(dtype), 4, 4)


def _framed(frame: ParallelFrame) -> Shot:
    middle = frame.origin + 7.5 * frame.a + 6.0 * frame.b + frame.f
    side = np.sign(frame.f @ np.cross(frame.a, frame.b)) * np.cross(frame.a, frame.b)
    eye = middle + 16.0 * side / np.linalg.norm(side) + 6.0 * frame.a - 8.0 * frame.b
    return relief(frame, rough(), look(eye, middle, 45.0))


def _stretched(frame: ParallelFrame) -> Shot:
    target = np.array([7.5e3, 6.0, 1.0])
    return relief(frame, rough(), look(target + np.array([6e3, -9.0, 12.0]), target, 40.0))


def value_cases() -> Iterator[Case | Refusal]:
    """Group 9."""
    yield Case(
        "heights-negative", 9, "heights from -3 to -1", lambda: relief(PLAIN, rough() - 3, _oblique(SHAPE, -2.0))
    )
    yield Case("colours-to-1e4", 9, "light of ten thousand times white beside black", _hdr)
    flat, bad = np.zeros((3, 4)), np.full((3, 4), 1.0)
    bad[1, 1] = np.inf
    plain, camera = colors((3, 4)), Camera.look_at((0, 0, 5), (0, 0, 0), width=4, height=3)
    refused = {
        "infinite-height": ("a height is infinite", lambda dt: ReliefTexture(PLAIN, plain.astype(dt), bad.astype(dt))),
        "infinite-colour": ("a colour is infinite",
                            lambda dt: ReliefTexture(PLAIN, (plain * bad[..., None]).astype(dt), flat)),
        "nan-colour": ("a colour is NaN", lambda dt: ReliefTexture(PLAIN, (plain * np.nan).astype(dt), flat)),
        "negative-colour": ("a colour is negative", lambda dt: ReliefTexture(PLAIN, (plain - 2.0).astype(dt), flat)),
        "negative-depth": ("a depth image behind its camera",
                           lambda dt: DepthImage(camera, plain, (flat - 1.0).astype(dt))),
        "nan-layer-depth": ("a sample at depth NaN", lambda dt: layered_at(np.nan, dt)),
        "descending-layers": ("samples that do not ascend", lambda dt: layered_at(-1.0, dt)),
        "shapes-differ": ("colour of another size", lambda dt: ReliefTexture(PLAIN, plain[:2].astype(dt), flat)),
    }  # fmt: skip
    for name, (what, build) in refused.items():
        yield Refusal(f"refused-{name}", 9, what, build)


def layered_at(second: float, dtype: str) -> LayeredDepthImage:
    """Two samples in one texel, at depth 1 and `second`."""
    up = np.tile([0.0, 0.0, -1.0], (2, 1))
    return LayeredDepthImage(PLAIN, np.array([[0, 2]]), np.array([1.0, second], dtype), np.ones((2, 3)), up)


def _hdr() -> Shot:
    color = colors(SHAPE)
    color[3:6, 4:8], color[6:9, 8:12] = 1e4, 0.0
    return relief(PLAIN, rough(), _oblique(SHAPE), color)
