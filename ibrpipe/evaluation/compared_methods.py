"""Who takes part in an evaluation: the renderers' frames and the plain baselines, to be scored and timed alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from ibrpipe.capture.photo_set import PhotoSet
from ibrpipe.embree import MeshCaster
from ibrpipe.evaluation.baselines import render_median, render_ulr
from ibrpipe.evaluation.timing import Draw, Method
from ibrpipe.io.frames import Frames
from ibrpipe.io.views import View
from ibrpipe.renderers.api import Prepared, prepare, render
from ibrpipe.renderers.registry import shows_view_dependence
from ibrpipe.renderers.renderer_spec import Choice, choose, with_samples
from ibrpipe.types import Asset, Camera, Frame

#: what a timed frame holds
TIMED_OUTPUTS = ("color", "depth")


@dataclass(frozen=True)
class ComparedMethods:
    """Everything that is scored and timed, by name.

    Attributes
    ----------
    renderers, baselines : dict
        Name to the function that makes a view's frame.
    timed : dict
        Name to the method as it is timed; the names are those of `renderers` and `baselines`.
    """

    renderers: dict[str, Callable[[View], Frame]]
    baselines: dict[str, Callable[[View], Frame]]
    timed: dict[str, Method]


def compare_methods(asset: Asset, frames: Frames, caster: MeshCaster, photos: PhotoSet) -> ComparedMethods:
    """Prepare every renderer of `frames`, diffuse-only, the lumigraph and the mesh in median colours.

    Raises
    ------
    RendererError
        A renderer is unknown or cannot render the asset.
    """
    choices = {name: with_samples(choose(name), frames.samples) for name in frames.renderers}
    prepared = {name: prepare(asset, choice.name) for name, choice in choices.items()}
    first, samples = frames.renderers[0], frames.samples
    ready, diffuse = prepared[first], _without_view_dependence(choices[first])
    return ComparedMethods(
        renderers={name: _frame_of(frames, choice, prepared[name]) for name, choice in choices.items()},
        baselines={
            "diffuse": lambda view: render(ready, view.camera, diffuse.name, **diffuse.options),
            "ulr": lambda view: render_ulr(view.camera, caster, photos, samples),
            "mesh": lambda view: render_median(view.camera, caster, photos, samples),
        },
        timed={
            **{name: _method(choice, prepared[name]) for name, choice in choices.items()},
            "diffuse": _method(diffuse, ready),
            "ulr": lambda camera: lambda: render_ulr(camera, caster, photos, samples),
            "mesh": caster.prepared_cast,
        },
    )


def _without_view_dependence(choice: Choice) -> Choice:
    if not shows_view_dependence(choice.name):
        return choice
    return replace(choice, options={**choice.options, "residuals": False})


def _frame_of(frames: Frames, choice: Choice, prepared: Prepared) -> Callable[[View], Frame]:
    """Return a function that loads the render stage's frame of a view, or renders what that stage did not."""

    def load_or_render(view: View) -> Frame:
        found = frames.load(choice.text, view)
        return found or render(prepared, view.camera, choice.name, **choice.options)

    return load_or_render


def _method(choice: Choice, prepared: Prepared) -> Method:
    def prepare(camera: Camera) -> Draw:
        return lambda: render(prepared, camera, choice.name, TIMED_OUTPUTS, **choice.options)

    return prepare
