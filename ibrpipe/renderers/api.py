"""The public functions `prepare`, `render` and `renderers`: they check, choose the renderer, and call it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from ibrpipe.errors import RendererError
from ibrpipe.renderers.option_check import checked_options
from ibrpipe.renderers.option_text import option_texts
from ibrpipe.renderers.registry import find_renderer, registered
from ibrpipe.renderers.renderer import Renderer, type_names
from ibrpipe.types import Asset, Camera, Frame, Scene
from ibrpipe.types.prerendered import PrerenderedScene
from ibrpipe.types.renderable import Renderable

#: what a frame can hold
OUTPUTS = ("color", "depth", "alpha")


@dataclass(frozen=True, eq=False)
class Prepared:
    """Sources with the tables and pyramids that one renderer needs; made by `prepare`, accepted by `render`.

    Attributes
    ----------
    renderer : str
    sources : tuple
        In the order given; an asset counts as its textures.
    data : object
        Belongs to the renderer.
    bytes : int
        Bytes held beyond the sources.
    """

    renderer: str
    sources: tuple[Renderable | Scene | PrerenderedScene, ...]
    data: Any
    bytes: int

    def __repr__(self) -> str:
        """Return the renderer, how many sources there are, and what is held beyond them."""
        return f"Prepared({self.renderer!r}, {len(self.sources)} sources, {self.bytes / 1e6:.1f} MB)"


Source = Renderable | Asset | Scene | PrerenderedScene | Prepared | Sequence["Renderable | Asset"]


def prepare(source: Source, renderer: str = "ldi") -> Prepared:
    """Build once what `renderer` needs to render `source`.

    Parameters
    ----------
    source : ReliefTexture, DepthImage, LayeredDepthImage, Texture, ReliefMesh, Asset, or a list of these; a Scene
        Of a scene, a renderer that knows none draws what was captured, and `hierarchical` the meshes.
    renderer : str
        A name from `renderers`.

    Returns
    -------
    Prepared

    Raises
    ------
    RendererError
        Unknown renderer, nothing to render, or a source that it cannot take.
    """
    chosen = find_renderer(renderer)
    if isinstance(source, Prepared):
        if source.renderer != renderer:
            raise RendererError(f"this was prepared for {source.renderer!r}, not {renderer!r}; prepare the source anew")
        return source
    if isinstance(source, Scene | PrerenderedScene) and _is_joined((source,), chosen):
        from ibrpipe.renderers.joined_scenes import join_scene

        joined = join_scene(source, renderer)
        return Prepared(renderer, (source,), joined, joined.bytes)
    sources = tuple(_flatten(source))
    if not sources:
        raise RendererError("there is nothing to render: the list or asset is empty; give at least one texture")
    for each in sources:
        if not isinstance(each, chosen.accepts):
            taken = ", ".join(type_names(chosen.accepts))
            raise RendererError(f"renderer {renderer!r} cannot take a {type(each).__name__}; it takes: {taken}")
    from ibrpipe.compile_progress import compiling_told

    with compiling_told():
        data = chosen().prepare(sources)
    return Prepared(renderer, sources, data, int(data.bytes))


def render(
    source: Source,
    camera: Camera,
    renderer: str = "ldi",
    outputs: Iterable[str] = OUTPUTS,
    **options: Any,
) -> Frame:
    """Render `source` as `camera` sees it.

    Parameters
    ----------
    source : a source, a list of sources (composited by depth), an Asset, or what `prepare` returned
    camera : Camera
    renderer : str
        A name from `renderers`.
    outputs : names among "color", "depth", "alpha"
        What is not asked for is not computed.
    **options
        Options of the renderer; `renderers` lists them.

    Returns
    -------
    Frame
        Colour (H, W, 3) linear, not multiplied by alpha; depth (H, W) along camera z with +inf where nothing is hit;
        alpha (H, W), the share of the pixel that is covered. All float32.

    Raises
    ------
    RendererError
        Unknown renderer, output, option or kind of source, or an option that cannot be what it is.
    """
    chosen = find_renderer(renderer)
    checked = checked_options(chosen, options)
    wanted = (outputs,) if isinstance(outputs, str) else tuple(outputs)
    for name in wanted:
        if name not in OUTPUTS:
            raise RendererError(f"unknown output {name!r}; choose among: {', '.join(OUTPUTS)}")
    if not isinstance(camera, Camera):
        raise RendererError(f"camera must be a Camera, got {type(camera).__name__}; build one with ibrpipe.Camera")
    from ibrpipe.compile_progress import compiling_told

    with compiling_told():
        prepared = prepare(source, renderer)
        if _is_joined(prepared.sources, chosen):
            return prepared.data.draw(camera, wanted, {name: getattr(checked, name) for name in options})
        return _drawn(prepared, camera, chosen(), wanted, checked)


def _is_joined(sources: tuple[Any, ...], chosen: type[Renderer[Any, Any]]) -> bool:
    """Whether a scene is given to a renderer that knows none."""
    return isinstance(sources[0], Scene | PrerenderedScene) and not isinstance(sources[0], chosen.accepts)


def _drawn(
    prepared: Prepared, camera: Camera, drawer: Renderer[Any, Any], wanted: tuple[str, ...], checked: Any
) -> Frame:
    """Draw with as many rays a pixel as the options say."""
    samples = getattr(checked, "samples", 1)
    if samples == 1 or (samples == "adaptive" and not {"color", "alpha"} & set(wanted)):
        return drawer.draw(prepared.data, camera, wanted, checked)  # several rays at edges leave depth as it is
    if samples == "adaptive":
        return drawer.draw_adaptive(prepared.data, camera, wanted, checked)
    from ibrpipe.renderers.antialiasing import supersample

    return supersample(lambda view, names: drawer.draw(prepared.data, view, names, checked), camera, wanted, samples)


def renderers() -> dict[str, dict[str, Any]]:
    """Return, by name, what each renderer can render, its paper, its limits and its options."""
    return {
        name: {
            "summary": entry.summary,
            "paper": entry.paper,
            "limits": entry.limits,
            "accepts": type_names(entry.accepts),
            "options": option_texts(entry.Options),
        }
        for name, entry in registered().items()
    }


def _flatten(source: Any) -> Iterable[Renderable | Scene | PrerenderedScene]:
    if isinstance(source, Asset):
        yield from source.textures
    elif isinstance(source, list | tuple):
        for part in source:
            if isinstance(part, Prepared):
                raise RendererError("a list cannot hold prepared sources; prepare the whole list instead")
            yield from _flatten(part)
    else:
        yield source
