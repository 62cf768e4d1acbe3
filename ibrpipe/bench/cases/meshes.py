"""Relief-mapped meshes: what of every group applies to them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from ibrpipe.bench.cases.case import MeshCase, MeshShot, Refusal, colors, look
from ibrpipe.types import Array, Camera, Mesh
from ibrpipe.types.relief_mesh import ReliefMesh

NAN = float("nan")
#: one square of two faces, its texture upright
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
SQUARE_UV = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], float)
EYE, MIDDLE = (0.8, -1.5, 1.1), (0.0, 0.0, -0.1)


def noise(shape: tuple[int, int] = (9, 12), seed: int = 3) -> Array:
    """(H, W) float64 heights between 0 and 1."""
    return np.random.default_rng(seed).random(shape)


def _at(eye: Any, target: Any = MIDDLE, fov: float = 45.0, up: Any = (0, 0, 1)) -> Camera:
    return look(eye, target, fov, up=up)


def _shot(vertices: Any, faces: Any, uv: Any, height: Array, camera: Camera, **more: Any) -> MeshShot:
    source = ReliefMesh(
        Mesh(np.asarray(vertices, float), faces),
        uv,
        height,
        more.pop("thickness", 0.4),
        color=colors(height.shape),
        **more,
    )
    return MeshShot(source, camera, np.asarray(height, np.float64))


def _square(height: Array | None = None, camera: Camera | None = None, repeat: float = 1.0, **more: Any) -> MeshShot:
    heights = noise() if height is None else height
    return _shot(SQUARE, FACES, SQUARE_UV * repeat, heights, camera or _at(EYE), **more)


def sheet(n: int = 3) -> tuple[Array, Array, Array]:
    """Vertices, faces and texture coordinates of a bent sheet of n x n squares with shared vertices."""
    y, x = np.mgrid[: n + 1, : n + 1] / n
    places = np.stack([2 * x - 1, 2 * y - 1, 0.5 - (x - 0.5) ** 2 - 0.7 * (y - 0.5) ** 2], -1).reshape(-1, 3)
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + n + 2], 1), np.stack([i, i + n + 2, i + n + 1], 1)])
    return places, faces, np.stack([x, 1 - y], -1).reshape(-1, 2)[faces]


def _bent(texture: Any = ((2, 0), (0, 2)), place: Any = None, **more: Any) -> MeshShot:
    """The sheet with its texture coordinates and its places each multiplied by a matrix."""
    vertices, faces, uv = sheet()
    transform = np.eye(3) if place is None else np.asarray(place, float)
    if np.linalg.det(transform) < 0:
        faces, uv = faces[:, ::-1], uv[:, ::-1]
    eye, target = (np.asarray(point) @ transform.T for point in ((0.8, -1.9, 1.3), (0.0, 0.0, 0.2)))
    return _shot(vertices @ transform.T, faces, uv @ np.asarray(texture, float), noise(), _at(eye, target),
                 thickness=more.pop("thickness", 0.15), **more)  # fmt: skip


def _broken(what: str) -> MeshShot:
    """The sheet with some faces of no area, or of no area in the texture, or slivers."""
    vertices, faces, uv = sheet()
    if what == "faces":
        faces[4, 1] = faces[4, 0]
    elif what == "slivers":
        vertices[5] = vertices[6] + (-1e-4, 0, 0)
    elif what == "line":
        vertices = vertices * (1.0, 0.0, 0.0)
    else:
        uv[4], uv[11, 1] = uv[4, 0], uv[11, 0]
    return _shot(vertices, faces, 2 * uv, noise(), _at((0.8, -1.9, 1.3), (0, 0, 0.2)), thickness=0.15)


def _grazing(degrees: float) -> MeshShot:
    angle = np.radians(degrees)
    eye = np.array([3.0 * np.sin(angle) * 0.9, 3.0 * np.sin(angle) * 0.436, 3.0 * np.cos(angle)])
    return _square(camera=_at(eye, (0, 0, 0), 20.0), thickness=0.05, repeat=1.5)


def _along_depth(dx: float, dy: float) -> MeshShot:
    """Rays that part by ten-thousandths, through places of the texels: 8 texels a side, one a pixel."""
    R = np.diag([1.0, -1.0, -1.0])
    eye = np.array([-0.25 * dx, -0.25 * dy, 2.5e4])
    camera = Camera(np.array([[1e5, 0, 5.0], [0, 1e5, 5.0], [0, 0, 1]]), np.c_[R, -R @ eye], 10, 10)
    return _square(noise((8, 8)), camera)


def _spot(base: float, spike: float) -> Array:
    height = np.full((12, 12), base)
    height[5, 7] = spike
    return height


def _scene(scale: float, away: float, **more: Any) -> MeshShot:
    move = np.array([away, -away, away])
    camera = _at(move + scale * np.array(EYE), move + scale * np.array(MIDDLE))
    return _shot(SQUARE * scale + move, FACES, SQUARE_UV, noise(), camera, thickness=0.4 * scale, **more)


def mesh_cases() -> Iterator[MeshCase | Refusal]:
    """All groups but the second and the seventh."""
    yield from _eye_and_ray_cases()
    yield from _relief_cases()
    yield from _size_cases()
    yield from _mapping_cases()
    yield from _refusals()


def _eye_and_ray_cases() -> Iterator[MeshCase]:
    eyes = {
        "eye-above": ("seen from 45 degrees", EYE, MIDDLE),
        "eye-just-above-polygon": ("a thousandth above a polygon", (-0.5, -0.4, 1e-3), (0.6, 0.5, -0.3)),
        "eye-in-polygon-plane": ("the eye lies in the plane of the polygons", (-2.5, 0.3, 0.0), (0.0, 0.0, -0.2)),
        "eye-above-texel-corner": ("the eye stands over the corner of four texels", (0.0, 0.0, 0.9), (0.02, 0.01, 0)),
    }
    for name, (what, eye, target) in eyes.items():
        yield MeshCase(f"mesh-{name}", 1, what, partial(_square, camera=_at(eye, target)))
    flat = np.zeros((9, 12))
    flat[:, 7:] = 0.9
    yield MeshCase("mesh-eye-inside-shell", 1, "the eye lies below the polygon, above the relief",
                   partial(_square, flat, _at((-0.6, 0.1, -0.2), (0.5, 0.0, -0.25)), edges="cut"))  # fmt: skip
    for degrees in (0.0, 80.0, 85.0, 89.0, 89.9):
        what = f"seen {degrees:g} degrees off the normal"
        yield MeshCase(f"mesh-grazing-{degrees:g}", 3, what, partial(_grazing, degrees))
    places = {"texel-centres": (0.5, 0.5), "texel-boundaries": (0.0, 0.5), "texel-corners": (0.0, 0.0)}
    for name, (dx, dy) in places.items():
        what = f"rays along depth, all through {name.replace('-', ' ')}"
        yield MeshCase(f"mesh-rays-through-{name}", 3, what, partial(_along_depth, dx, dy))
    yield MeshCase("mesh-rays-along-row", 3, "the middle ray runs along texel centres",
                   partial(_square, noise((8, 8)), _at((-3.0, 0.125, 0.7), (0.0, 0.125, -0.2), 30.0)))  # fmt: skip


def _relief_cases() -> Iterator[MeshCase]:
    step = np.zeros((12, 12))
    step[:, 6:] = 1.0
    checks = (np.indices((12, 12)).sum(axis=0) % 2).astype(float)
    reliefs = {
        "spike": ("one texel stands up to the polygon", _spot(0.2, 1.0)),
        "pit": ("one texel is a pit", _spot(1.0, 0.0)),
        "step": ("a cliff over the whole depth", step),
        "checks": ("every texel beside another extreme", checks),
        "deepest": ("constant, at the bottom", np.zeros((6, 6))),
        "highest": ("constant, on the polygon", np.ones((6, 6))),
        "halfway": ("constant, half way down", np.full((6, 6), 0.5)),
    }
    for name, (what, height) in reliefs.items():
        yield MeshCase(f"mesh-surface-{name}", 4, what, partial(_square, height))
        if name in ("spike", "pit", "step"):
            low = partial(_square, height, _at((2.6, 1.2, 0.12), (0, 0, -0.05), 30.0), thickness=0.2)
            yield MeshCase(f"mesh-surface-{name}-grazing", 4, f"{what}; seen from low down", low)
    yield MeshCase("mesh-tiled", 4, "tiled 3.7 times: rays cross the seams", partial(_square, repeat=3.7))
    yield MeshCase("mesh-cut", 4, "the texture ends within the polygon", partial(_square, repeat=1.3, edges="cut"))
    wall = noise()
    yield MeshCase("mesh-dual-thin", 4, "two depths, the wall between them a hundredth thick",
                   partial(_square, wall, back=np.maximum(wall - 0.01, 0.0), edges="cut"))  # fmt: skip
    holes = np.where(checks > 0, 0.0, 0.9)
    yield MeshCase("mesh-dual-holes", 4, "two depths that cross: every other texel is a hole",
                   partial(_square, holes, back=np.full((12, 12), 0.4)))  # fmt: skip
    yield MeshCase("mesh-bits", 6, "depth in few bits", _square)
    yield MeshCase("mesh-bits-grazing", 6, "the same at 85 degrees", partial(_grazing, 85.0))


def _size_cases() -> Iterator[MeshCase]:
    for rows, columns in ((1, 1), (1, 9), (9, 1), (2, 2), (33, 5), (7, 13)):
        for edges in ("wrap", "cut"):
            what = f"a relief of {columns} x {rows} texels, {'tiled' if edges == 'wrap' else 'cut at its edge'}"
            build = partial(_square, noise((rows, columns)), repeat=2.0 if edges == "wrap" else 1.0, edges=edges)
            yield MeshCase(f"mesh-size-{columns}x{rows}-{edges}", 5, what, build)
    scenes = {"far": (1.0, 1e6), "tiny": (1e-6, 0.0), "huge": (1e6, 0.0), "huge-and-far": (1e3, 1e6)}
    for name, (scale, away) in scenes.items():
        what = f"{2 * scale:g} units wide, {away:g} units from the origin"
        yield MeshCase(f"mesh-scene-{name}", 5, what, partial(_scene, scale, away))


def _mapping_cases() -> Iterator[MeshCase]:
    textures = {
        "mirrored": ((-2, 0), (0, 2)),
        "turned": ((0, 2), (-2, 0)),
        "sheared": ((0.8, 0.5), (-1.9, 1.1)),
        "stretched": ((30, 0), (0, 0.25)),
    }
    for name, matrix in textures.items():
        yield MeshCase(f"mesh-uv-{name}", 8, f"texture coordinates {name}", partial(_bent, matrix))
    places = {
        "mirrored": np.diag([-1.0, 1.0, 1.0]),
        "sheared": ((1, 0.9, 0), (0, 1, 0), (0, 0.3, 1)),
        "non-uniform": np.diag([100.0, 1.0, 1.0]),
        "flattened": np.diag([1.0, 1.0, 1e-3]),
    }
    for name, place in places.items():
        yield MeshCase(f"mesh-instance-{name}", 8, f"the instance's matrix is {name}", partial(_bent, place=place))
    yield MeshCase("mesh-instance-singular", 8, "the instance's matrix makes a line of it: nothing to see",
                   partial(_broken, "line"))  # fmt: skip
    broken = {
        "faces": "one face has no area",
        "slivers": "faces a ten-thousandth wide",
        "textures": "faces without area in the texture are shown without relief",
    }
    for name, what in broken.items():
        yield MeshCase(f"mesh-degenerate-{name}", 8, what, partial(_broken, name))


def _refusals() -> Iterator[Refusal]:
    grid = noise((4, 4))

    def make(**change: Any) -> ReliefMesh:
        parts = {"mesh": Mesh(SQUARE, FACES), "uv": SQUARE_UV, "height": grid, "thickness": 0.4}
        return ReliefMesh(**{**parts, **change})

    def render(vertices: Array) -> object:
        from ibrpipe.renderers.api import render as draw

        return draw(make(), _at(EYE), "relief", vertices=vertices)

    wrong = {
        "nan-height": ("a height is NaN", lambda dt: make(height=(grid * NAN).astype(dt))),
        "infinite-height": ("a height is infinite", lambda dt: make(height=(grid + np.inf).astype(dt))),
        "height-beyond-1": ("a height is above the polygon", lambda dt: make(height=(grid + 1.0).astype(dt))),
        "nan-back": ("a back height is NaN", lambda dt: make(back=(grid * NAN).astype(dt))),
        "nan-vertex": ("a vertex is NaN", lambda dt: Mesh((SQUARE * NAN).astype(dt), FACES)),
        "nan-moved-vertex": ("a vertex of a deforming mesh is NaN", lambda dt: render((SQUARE * NAN).astype(dt))),
        "nan-uv": ("a texture coordinate is NaN", lambda dt: make(uv=(SQUARE_UV * NAN).astype(dt))),
        "infinite-colour": ("a colour is infinite", lambda dt: make(color=np.full((2, 2, 3), np.inf, dt))),
        "nan-normal": ("a mapped normal is NaN", lambda dt: make(normal=np.full((2, 2, 3), NAN, dt))),
        "no-thickness": ("the relief has no thickness", lambda dt: make(thickness=0.0)),
        "nan-light": ("the lamp is at NaN", lambda dt: _lit(make(), (NAN, 0, 1))),
    }  # fmt: skip
    for name, (what, build) in wrong.items():
        yield Refusal(f"refused-mesh-{name}", 9, what, build)


def _lit(source: ReliefMesh, light: Any) -> object:
    from ibrpipe.renderers.api import render

    return render(source, _at(EYE), "relief", light=light)
