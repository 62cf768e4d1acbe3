"""Scenes of copies: matrices, eyes, sizes, ties, and parts that are almost nothing (max1999)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from typing import Any

import numpy as np

from ibrpipe.bench.cases.case import CopiesCase, Refusal, SceneShot
from ibrpipe.synthetic.instanced.pieces import painted_box, placed, turned
from ibrpipe.synthetic.instanced.solids import painted_ball
from ibrpipe.types import Array, Camera, Instances, Mesh, PaintedMesh, Part, Scene
from ibrpipe.types.prerendered import Prerendered, PrerenderedScene

RED, BLUE = (0.6, 0.2, 0.1), (0.1, 0.3, 0.6)
#: pixels of a picture, and its focal length
SIZE, FOCAL = (48, 36), 60.0
#: where the second copy stands that makes a part one that is drawn from slices: behind the eye
AWAY = placed((0.0, -1e3, 0.0))
#: distance over radius at which parts are no longer drawn from slices
SWITCH = 1.5
NAN = float("nan")


def copies_cases() -> Iterator[CopiesCase | Refusal]:
    """Return the cases of scenes of copies."""
    yield from _eyes()
    yield from _surfaces()
    yield from _sizes()
    yield from _matrices()
    yield from _refusals()


def _eyes() -> Iterator[CopiesCase]:
    places = {
        "inside": (0.4, "the eye inside a part"),
        "at-centre": (0.0, "the eye on the centre of a part"),
        "switching-below": (SWITCH - 1e-4, "the eye a little nearer than where parts are taken apart"),
        "switching-above": (SWITCH + 1e-4, "the eye a little farther than where parts are taken apart"),
    }
    for name, (distance, what) in places.items():
        yield _case(f"eye-{name}", 1, what, _ball, camera=_look(distance))
    yield _case("near-plane", 1, "a part across the near plane", _plate, camera=_look(0.5, 3e-3))


def _surfaces() -> Iterator[CopiesCase]:
    tie = "surfaces at one depth: either may be seen"
    yield _case("depth-ties", 4, "plates of two colours at one depth", _two_plates, camera=_look(30.0), colors_tie=tie)
    same = np.stack([np.eye(4)] * 5)
    yield _case("coincident", 4, "five copies in one place", _ball, same, _look(24.0))
    yield _case("empty-part", 4, "a part without anything in it, three times", _nothing, np.stack([np.eye(4)] * 3))
    leaves = np.stack([placed((1.2 * n - 1.2, 0, 0)) for n in range(3)])
    yield _case("one-triangle", 4, "a part of one triangle", _triangle, leaves, _look(20.0))
    yield _case("one-texel", 4, "parts of half a pixel", _ball, _spread(np.eye(4), (10, 8), 8.0), _look(240.0))
    wires = _spread(np.eye(4), (9, 7), 3.2, True)
    yield _case("wires", 4, "wires a sixth of a texel wide", _wires, wires, _look(40.0), side=16)
    yield _case("opaque-sphere", 4, "a ball that nothing may be seen through", _ball, camera=_look(10.0))
    yield _case("outline", 4, "a ball of two slabs, as wide as it is", _ball, camera=_look(16.0))
    walls = np.stack([placed((3.0 * n - 3.0, 0, 0), turned((1, 0.3 * n, 0.2), 0.4 * n + 0.3)) for n in range(3)])
    yield _case("slanted-walls", 4, "walls at a slant that nothing may be seen through", _wall, walls, _look(32.0))


def _sizes() -> Iterator[CopiesCase]:
    many = _spread(np.eye(4))
    yield _case("nested-scales", 5, "a part made 1e4 times smaller, and 1e4 times larger again", _nested, many)
    shift = np.array([1e6, -1e6, 1e6])
    yield _case("far-from-origin", 5, "1e6 units from the origin", _ball, placed(shift) @ many, _look(24.0, at=shift))
    smaller = placed((0, 0, 0), None, 1e-4)
    yield _case("tiny", 5, "copies of 1e-4", _ball, smaller @ many, _look(24e-4))
    far = np.stack([placed((0, 3.0, 0), None, 0.5), placed((0, 3e6, 6e5), None, 5e5)])
    yield _case("near-far", 5, "a copy at 3 units, another at 3 million", _ball, far, _look(0.0, reach=3.0))


def _matrices() -> Iterator[CopiesCase]:
    turn = turned((1, 2, 3), 1.0)
    shear = np.eye(4)
    shear[0, 2] = 1.5
    matrices = {
        "mirrored": (placed((0, 0, 0), np.diag([-1.0, 1, 1])), "a mirrored copy"),
        "stretched": (placed((0.5, 0, 0), turn @ np.diag([0.5, 1.5, 3.0])), "0.5, 1.5 and 3 times as wide"),
        "sheared": (shear, "a sheared copy"),
        "nearly-flat": (placed((0, 0, 0), turn, np.array([1.0, 1.0, 1e-9])), "a billionth as thick"),
        "flat": (placed((0, 0, 0), turn @ np.diag([1.0, 1, 0])), "a singular matrix: flat"),
        "rank-1": (placed((0, 0, 0), np.diag([1.0, 0, 0])), "a singular matrix: a line"),
        "rank-0": (placed((0, 0, 0), np.zeros((3, 3))), "a singular matrix: a point"),
    }
    for name, (matrix, what) in matrices.items():
        yield _case(f"matrix-{name}", 8, what, _ball, _spread(matrix), _look(24.0))


def _refusals() -> Iterator[Refusal]:
    entries = {"nan": (0, 0, NAN), "infinite": (2, 3, np.inf), "last-row": (3, 0, 1.0)}
    for name, entry in entries.items():
        what = f"a copy's matrix with {entry[2]} in row {entry[0]}"
        yield Refusal(f"refused-copies-{name}", 9, what, partial(_broken, *entry))
    yield Refusal("refused-copies-texels", 9, "slices of more than 2^31 texels", _too_many_texels)
    yield Refusal("refused-copies-directions", 9, "more directions than are told apart", _too_many_directions)
    yield Refusal("refused-copies-count", 9, "1e24 copies, all as polygons", _too_many_copies)


def _case(
    name: str,
    group: int,
    what: str,
    parts: Callable[[], tuple[Part, ...]],
    matrices: Array | None = None,
    camera: Camera | None = None,
    colors_tie: str = "",
    side: int = 8,
) -> CopiesCase:
    """A case with copies of the last of some parts; one as it is, seen from 24 units, unless given."""
    copies = np.eye(4)[None] if matrices is None else np.atleast_3d(matrices).reshape(-1, 4, 4)
    return CopiesCase(
        f"copies-{name}", group, what, partial(_shot, parts, copies, camera or _look(24.0), side), colors_tie
    )


def _shot(parts: Callable[[], tuple[Part, ...]], matrices: Array, camera: Camera, side: int) -> SceneShot:
    made = parts()
    scene = _scene(made, np.concatenate([matrices, AWAY[None]]))
    return SceneShot(PrerenderedScene(scene, _library(parts)), camera, side)


def _scene(parts: Sequence[Part], matrices: Array) -> Scene:
    return Scene([*parts, Part("root", children=(Instances(parts[-1].name, matrices),))], "root")


@cache
def _library(parts: Callable[[], tuple[Part, ...]]) -> Prerendered:
    """The slices of parts, which all cases share; fewer and coarser than usual, to be quick."""
    from ibrpipe.renderers.hierarchical.forms import prerender
    from ibrpipe.renderers.hierarchical.prefiltering import Slicing

    return prerender(_scene(parts(), np.stack([np.eye(4), AWAY])), Slicing(96, 6.0, 4, 16)).library


def _look(
    distance: float,
    above: float = 0.0,
    at: Any = (0.0, 0.0, 0.0),
    reach: float = 0.0,
    size: tuple[int, int] = SIZE,
) -> Camera:
    """A camera that looks at a place from `distance` and 9 degrees above; from close by, or with `reach`, past it.

    There `above` is how much higher the camera stands than the place.
    """
    target, fov = np.asarray(at, np.float64), float(np.degrees(2 * np.arctan(0.5 * size[1] / FOCAL)))
    eye = target + distance * np.array([0.0, -0.9877, 0.1564])
    if distance < 1.0 or reach:
        eye = target + np.array([0.0, -distance, above])
        target = eye + np.array([0.0, 1.0, 0.2])
    return Camera.look_at(eye, target, fov_y_deg=fov, width=size[0], height=size[1])


def _spread(matrix: Array, grid: tuple[int, int] = (4, 3), step: float = 4.5, turns: bool = False) -> Array:
    """(N, 4, 4): copies of a copy across the view, away from a regular grid, turned each in another way or not."""
    rng = np.random.default_rng(4)
    across, up = (step * (np.arange(count) - 0.5 * (count - 1)) for count in grid)
    return np.stack(
        [
            placed((x, 0.0, z) + 0.12 * step * rng.uniform(-1, 1, 3), _turn(rng) if turns else None) @ matrix
            for x in across
            for z in up
        ]
    )


def _turn(rng: np.random.Generator) -> Array:
    return turned(rng.normal(size=3), rng.uniform(0, 2 * np.pi))


def _ball() -> tuple[Part, ...]:
    return (Part("ball", (painted_ball(1.0, RED, 10),)),)


def _wall() -> tuple[Part, ...]:
    return (Part("wall", (painted_box((-1.6, -0.1, -1.6), (1.6, 0.1, 1.6), BLUE),)),)


def _plate() -> tuple[Part, ...]:
    return (Part("plate", (painted_box((-4, -4, -0.5), (4, 4, 0.0), BLUE),)),)


def _two_plates() -> tuple[Part, ...]:
    plates = [painted_box((-2 + x, -0.1, -2 + x), (2 + x, 0.1, 2 + x), paint) for x, paint in ((0, RED), (1, BLUE))]
    first, second = (Part(name, (plate,)) for name, plate in zip(("red", "blue"), plates))
    return first, second, Part("both", children=(Instances("red", np.eye(4)), Instances("blue", np.eye(4))))


def _nested() -> tuple[Part, ...]:
    small = Instances("ball", placed((0, 0, 0), None, 1e-4))
    return (*_ball(), Part("small", children=(small,)), Part("again", children=(Instances("small", _larger()),)))


def _larger() -> Array:
    return placed((0, 0, 0), None, 1e4)


def _nothing() -> tuple[Part, ...]:
    return (Part("nothing"),)


def _triangle() -> tuple[Part, ...]:
    mesh = Mesh(np.array([[-0.5, 0, -0.5], [0.5, 0, -0.5], [0, 0.3, 0.5]]), np.array([[0, 1, 2]]))
    return (Part("triangle", (PaintedMesh(mesh, np.tile(np.array(RED, np.float32), (3, 1))),)),)


def _wires() -> tuple[Part, ...]:
    """Twelve wires, 2 long and 0.07 wide, all ways; a texel is 0.45 wide where the part is drawn from 6."""
    rng = np.random.default_rng(3)
    ends = rng.normal(size=(12, 3))
    ends /= np.linalg.norm(ends, axis=1, keepdims=True)
    wire = painted_box((-0.035, -0.035, -1.0), (0.035, 0.035, 1.0), RED)
    corners = [wire.mesh.vertices @ _towards(end).T + 0.15 * rng.normal(size=3) for end in ends]
    faces = np.concatenate([wire.mesh.faces + 8 * n for n in range(len(ends))])
    vertices = np.concatenate(corners)
    return (
        Part("wires", (PaintedMesh(Mesh(vertices, faces), np.tile(np.array(RED, np.float32), (len(vertices), 1))),)),
    )


def _towards(end: Array) -> Array:
    """Rotation that takes z to a unit vector."""
    axis = np.cross((0.0, 0.0, 1.0), end)
    return turned(axis, float(np.arctan2(np.linalg.norm(axis), end[2])))


def _broken(row: int, column: int, value: float, dtype: str) -> Instances:
    matrix = np.eye(4, dtype=dtype)
    matrix[row, column] = value
    return Instances("ball", matrix)


def _too_many_texels(dtype: str) -> object:
    from ibrpipe.renderers.hierarchical.forms import prerender
    from ibrpipe.renderers.hierarchical.prefiltering import Slicing

    copies = np.stack([np.eye(4), AWAY]).astype(dtype)
    return prerender(_scene(_ball(), copies), Slicing(65_535, 6.0, 1, 64))


def _too_many_directions(dtype: str) -> object:
    from ibrpipe.renderers.hierarchical.prefiltering import Slicing

    return Slicing(int(np.asarray(1 << 16, dtype)))


def _too_many_copies(dtype: str) -> object:
    from ibrpipe.renderers.api import render

    row = np.stack([placed((0.1 * n - 5, 0, 0), None, 0.1) for n in range(100)]).astype(dtype)
    parts = [*_triangle()]
    for _ in range(12):
        parts.append(Part(f"{len(parts)}", children=(Instances(parts[-1].name, row),)))
    shot = PrerenderedScene(Scene(parts, parts[-1].name), _library(_triangle))
    return render(shot, _look(24.0), "hierarchical", mode="polygons")
