"""The renderers by name. A renderer is a module with `prepare` and `draw`, imported when it is first used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

from ibrpipe.errors import RendererError


@dataclass(frozen=True)
class Renderer:
    """What is known of a renderer before it is loaded.

    Attributes
    ----------
    name : str
    module : str
        Module with ``prepare(sources) -> object`` and ``draw(data, camera, outputs, **options) -> Frame``.
    summary, paper, limits : str
        One sentence each: what it does, where it comes from, what it cannot do.
    accepts : tuple of str
        Kinds of source that it renders.
    options : mapping
        Name of each option of `draw` and what it does.
    """

    name: str
    module: str
    summary: str
    paper: str
    limits: str
    accepts: tuple[str, ...]
    options: Mapping[str, str]

    def load(self) -> ModuleType:
        """Import the module that renders."""
        return import_module(self.module)


_RENDERERS = (
    Renderer(
        name="ldi",
        module="ibrpipe.renderers.ldi",
        summary="Exact nearest hit by projected patches or a quadtree; depth-corrected spiral residuals.",
        paper="gong-yang, sec. 5",
        limits="Pinhole cameras; nearest surface only, no transparency.",
        accepts=("ReliefTexture", "DepthImage", "LayeredDepthImage", "SpiralTexture", "Texture", "Asset"),
        options={
            "residuals": "add the view-dependent residuals where a texture has them (default True)",
            "search": "auto, patches, lines or quadtree: how hits are found; all find the same (default auto)",
            "threads": "number of threads, 0 = all (default 0); never changes a byte of the result",
        },
    ),
    Renderer(
        name="epipolar",
        module="ibrpipe.renderers.epipolar.renderer",
        summary="Inverse warp along whole epipolar lines, exact or with nearest or interpolated reference samples.",
        paper="schaufler1999",
        limits="Pinhole cameras; view-independent colour; nearest and linear searches use the first layer.",
        accepts=("ReliefTexture", "DepthImage", "LayeredDepthImage", "SpiralTexture", "Texture", "Asset"),
        options={
            "search": "exact, nearest (as published) or linear: what a line meets (default exact)",
            "threads": "number of threads, 0 = all (default 0); never changes a byte of the result",
        },
    ),
    Renderer(
        name="prewarp",
        module="ibrpipe.renderers.prewarp.renderer",
        summary="1-D pre-warp of relief textures along rows and columns, then planar texture mapping.",
        paper="oliveira2000",
        limits="Parallel frames, first layer; sampled, so silhouettes are right to about a texel.",
        accepts=("ReliefTexture", "LayeredDepthImage", "SpiralTexture", "Texture", "Asset"),
        options={
            "method": "two-pass or pipelined: rows, then columns, or both interspersed (default two-pass)",
            "depth_bits": "8: heights as 254 levels with look-up tables; 32: floats (default 32)",
            "level": "level of the pyramid; auto: by the projected area (default auto)",
            "max_step": "texels of height between neighbours above which they are parted; None: as the source says",
            "fallback": "auto, never, always: exact search where the eye is in or very near a relief (default auto)",
            "filter": "point: taken at pixel centres; area: averaged over what a pixel covers (default point)",
            "quads": "auto: textures on the faces of one box are merged into at most three; each: each has its own",
            "threads": "number of threads, 0 = all (default 0); never changes a byte of the result",
        },
    ),
    Renderer(
        name="splat",
        module="ibrpipe.renderers.splat",
        summary="Forward warp of reference samples with footprints: the baseline beside the inverse warp.",
        paper="schaufler1999, sec. 3",
        limits="First layer; holes where a surface is turned away from the reference; depth constant over a footprint.",
        accepts=("ReliefTexture", "DepthImage", "LayeredDepthImage", "SpiralTexture", "Texture", "Asset"),
        options={
            "footprint": "size of a sample in texels (default 1)",
            "threads": "number of threads, 0 = all (default 0); never changes a byte of the result",
        },
    ),
    Renderer(
        name="relief",
        module="ibrpipe.renderers.relief.renderer",
        summary="Relief mapping of height fields and textured meshes, exactly or by linear and binary steps.",
        paper="policarpo2005",
        limits="Parallel frames, first layer; search='linear-binary' steps over thin features.",
        accepts=("ReliefTexture", "LayeredDepthImage", "SpiralTexture", "Texture", "Asset", "ReliefMesh"),
        options={
            "search": "exact: no feature is missed; linear-binary: as published (default exact)",
            "linear_steps": "steps of the published search along the ray (default 32)",
            "binary_steps": "halvings of the published search (default 8)",
            "least_steps": "meshes: steps of the published search along the normal (default 10)",
            "mapping": "meshes: relief, or the baselines parallax, bump, plain (default relief)",
            "model": "meshes: flat, as published, or shell: silhouettes follow the relief (default flat)",
            "light": "meshes: lamp at (x, y, z), or toward it (x, y, z, 0); None: colours as they are (default None)",
            "ambient": "meshes: share of light from everywhere, one or three numbers (default 0.25)",
            "diffuse": "meshes: share of the lamp's diffuse light (default 0.75)",
            "specular": "meshes: share of the lamp's highlight (default 0.15)",
            "shininess": "meshes: exponent of the highlight (default 20)",
            "shadows": "meshes: the relief shades itself (default True)",
            "anisotropy": "meshes: probes of a pixel's footprint; 0: bilinear, no mip maps (default 8)",
            "two_sided": "meshes: polygons are seen from behind, without relief (default False)",
            "vertices": "meshes: (V, 3) places of the vertices in this frame, for deforming meshes (default None)",
            "threads": "number of threads, 0 = all (default 0); never changes a byte of the result",
        },
    ),
)


def registered() -> dict[str, Renderer]:
    """Return all renderers by name."""
    return {renderer.name: renderer for renderer in _RENDERERS}


def find_renderer(name: str) -> Renderer:
    """Return the renderer called `name`.

    Raises
    ------
    RendererError
        There is none; the message names those that exist.
    """
    known = registered()
    if name not in known:
        raise RendererError(f"unknown renderer {name!r}; use one of: {', '.join(sorted(known))}")
    return known[name]


def check_options(renderer: Renderer, options: Mapping[str, Any]) -> None:
    """Raise `RendererError` when `options` names one that the renderer does not have."""
    unknown = sorted(set(options) - set(renderer.options))
    if unknown:
        raise RendererError(
            f"renderer {renderer.name!r} has no option {unknown[0]!r}; its options are: "
            f"{', '.join(sorted(renderer.options))}"
        )
