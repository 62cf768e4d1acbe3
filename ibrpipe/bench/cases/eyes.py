"""Groups 1 to 3: where the eye is, where its epipole falls, how its rays run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from ibrpipe.bench.cases.case import PLAIN, SHAPE, Case, Shot, look, relief, rough
from ibrpipe.types import Camera, DepthImage

MIDDLE = np.array([7.5, 6.0, 1.0])


def _seen(eye: tuple[float, float, float], target: tuple[float, float, float], fov: float = 50.0) -> Shot:
    return relief(PLAIN, rough(), look(eye, target, fov))


def eye_cases() -> Iterator[Case]:
    """Group 1."""
    top = float(rough()[5, 7])
    places = {
        "eye-in-source-plane": (
            "the eye lies in the plane of the texture (c.f = 0)",
            (7.5, -8.0, 0.0),
            (7.5, 6.0, 1.0),
        ),
        "eye-in-source-plane-over-texels": ("in the plane, within the texture", (7.5, 6.0, 0.0), (12.0, 9.0, 0.8)),
        "eye-at-texel-height": ("the eye is as high as a texel", (-6.0, 5.5, top), (7.5, 5.5, top)),
        "texels-behind-eye-plane": ("half of the texels lie behind the eye", (7.5, 6.0, 4.0), (15.0, 6.0, 2.0)),
        "eye-inside-volume": ("the eye lies between surface and highest texel", (7.3, 6.2, 1.9), (14.0, 9.0, 1.0)),
        "eye-inside-bounding-box": ("in the box below the surface, looking up", (7.3, 6.2, 0.3), (10.0, 8.0, 2.0)),
        "eye-on-texel": ("the eye is a point of the surface", (7.5, 5.5, top), (14.0, 9.0, 1.2)),
        "eye-just-above-texel": ("a thousandth of a texel above the surface", (7.5, 5.5, top + 1e-3), (14.0, 9.0, 1.2)),
        "eye-behind-source-plane": ("the surface is seen from its back", (4.0, 3.0, -9.0), (7.5, 6.0, 1.0)),
        "eye-looks-away": ("nothing is in view", (7.5, 6.0, 9.0), (7.5, 6.0, 30.0)),
    }
    for name, (what, eye, target) in places.items():
        yield Case(name, 1, what, partial(_seen, eye, target))


def _depth_source() -> DepthImage:
    camera = Camera.look_at((0.3, -0.2, 6.0), (0, 0, 0), (0, 1, 0), 40.0, 17, 13)
    y, x = np.mgrid[:13, :17]
    depth = 5.0 + 0.6 * np.sin(0.6 * x) + 0.4 * np.cos(0.8 * y)
    color = np.stack([x / 17, y / 13, 0.5 + 0 * x], axis=-1)
    return DepthImage(camera, color, depth)


def _from_reference(move: Callable[[Camera], np.ndarray], fov: float = 40.0, aim: float = 5.0) -> Shot:
    """Seen from the reference eye moved by `move`, towards the middle of the surface."""
    source = _depth_source()
    center = source.camera.center
    middle = center + aim * (source.camera.world_from_pixel @ (8.5, 6.5, 1.0))
    return Shot(source, look(center + move(source.camera), middle, fov, up=(0, 1, 0)))


def _toward(camera: Camera, u: float, v: float, share: float = 0.6) -> np.ndarray:
    return share * (camera.world_from_pixel @ (u, v, 1.0))


def _turned() -> Shot:
    source = _depth_source()
    eye = source.camera.center
    return Shot(source, look(eye, eye + source.camera.world_from_pixel @ (11.0, 4.0, 1.0), 30.0, up=(0.2, 1, 0)))


def epipole_cases() -> Iterator[Case]:
    """Group 2, for relief textures (the eye's foot on the texture) and depth images (the eye's picture in them)."""
    spots = {"texel-centre": (6.5, 5.5), "texel-edge": (7.0, 5.5), "texel-corner": (7.0, 6.0)}
    for name, (u, v) in spots.items():
        what = f"the eye stands over a {name.replace('-', ' ')}"
        yield Case(f"epipole-{name}-relief", 2, what, partial(_seen, (u, v, 9.0), (u, v, 0.0), 70.0))
        yield Case(f"epipole-{name}-depth-image", 2, f"the eye moves towards a {name.replace('-', ' ')}",
                   partial(_from_reference, partial(_toward, u=u, v=v)))  # fmt: skip
    sides = {"left": -1, "middle": 0, "right": 1}, {"above": -1, "within": 0, "below": 1}
    for column, du in sides[0].items():
        for row, dv in sides[1].items():
            eye = (7.3 + 13.0 * du, 6.2 + 11.0 * dv, 8.0)
            name = f"epipole-region-{row}-{column}"
            yield Case(f"{name}-relief", 2, "the eye's foot lies there", partial(_seen, eye, (7.5, 6.0, 1.0), 60.0))
            yield Case(f"{name}-depth-image", 2, "the eye's picture lies there",
                       partial(_from_reference, partial(_toward, u=8.3 + 14 * du, v=6.2 + 12 * dv)))  # fmt: skip
    for name, what, scale in (("epipole-at-infinity-relief", "1e4", 1e3), ("eye-ten-million-texels-away", "1e7", 1e6)):
        far = (7.5 + 8 * scale, 6.0 + 5 * scale, 6 * scale)
        yield Case(name, 2, f"the eye is {what} texels away",
                   partial(_seen, far, (7.5, 6.0, 1.0), float(np.degrees(20 / (11 * scale)))))  # fmt: skip
    yield Case("epipole-at-infinity-depth-image", 2, "the eye moves parallel to the image plane",
               partial(_from_reference, lambda camera: 0.5 * camera.R[0]))  # fmt: skip
    yield Case("coincident-eyes", 2, "the eye stays and turns: a pure homography", _turned)
    yield Case("coincident-cameras", 2, "the very view of the depth image", lambda: _own_view(_depth_source()))
    yield Case("forward-motion", 2, "the eye moves along its axis", partial(_from_reference, lambda c: 0.8 * c.R[2]))
    yield Case("backward-motion", 2, "the eye moves back", partial(_from_reference, lambda c: -2.0 * c.R[2]))


def _own_view(source: DepthImage) -> Shot:
    return Shot(source, source.camera)


def _grazing(degrees: float, low: float = 1.0) -> Shot:
    """The texture from `degrees` off its normal, over heights between 0 and `low` texels."""
    t, distance = np.radians(degrees), 40.0
    target = np.array([7.5, 6.0, 0.5 * low])
    eye = target + distance * np.array([np.sin(t) * np.cos(0.4), np.sin(t) * np.sin(0.4), np.cos(t)])
    return relief(PLAIN, rough(height=low), look(eye, target, 14.0))


def _parallel(du: float, dv: float, heights: np.ndarray | None = None) -> Shot:
    """Rays parallel to the depth axis to a few hundred-thousandths, one texel apart, at texel place (du, dv)."""
    pose = np.c_[np.eye(3), [-2.0 - du, -2.0 - dv, 1e5]]
    camera = Camera(np.array([[1e5, 0, 0.5], [0, 1e5, 0.5], [0, 0, 1]]), pose, 11, 8)
    return relief(PLAIN, rough() if heights is None else heights, camera)


def _along_axis(v: float, height: float) -> Shot:
    """The middle ray runs exactly along the texture's u axis, at row coordinate `v`."""
    return relief(PLAIN, rough(), look((-10.0, v, height), (7.0, v, height), 30.0))


def ray_cases() -> Iterator[Case]:
    """Group 3."""
    for degrees in (80.0, 85.0, 89.0, 89.9):
        name = f"grazing-{degrees:g}"
        yield Case(name, 3, f"seen {degrees:g} degrees off the normal", partial(_grazing, degrees))
        yield Case(f"{name}-low", 3, "the same over heights of a fiftieth of a texel", partial(_grazing, degrees, 0.02))
    places = {"texel-centres": (0.5, 0.5), "texel-boundaries": (0.0, 0.5), "texel-corners": (0.0, 0.0),
              "texel-quarters": (0.25, 0.75)}  # fmt: skip
    for name, (du, dv) in places.items():
        yield Case(f"rays-through-{name}", 3, f"rays along depth, all through {name.replace('-', ' ')}",
                   partial(_parallel, du, dv))  # fmt: skip
    top = float(rough()[5, 7])
    yield Case("rays-along-row-of-centres", 3, "a ray along u over texel centres", partial(_along_axis, 5.5, top))
    yield Case("rays-along-row-of-boundaries", 3, "a ray along u over texel edges", partial(_along_axis, 6.0, 1.2))
    yield Case("rays-axis-parallel-above", 3, "a ray along u just above all texels", partial(_along_axis, 6.3, 2.001))
    assert SHAPE == (12, 15)
