"""The contract of renderers: what a class says of itself and does. How to add one stands in ``docs/new-renderer.md``.

A renderer's class, and whatever is imported with it, is light: Numba and the kernels are imported inside `prepare` and
`draw`, so that listing renderers, ``--help`` and checks of options stay instant.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Generic, Literal, Protocol, TypeVar

from pydantic import ConfigDict, Field

from ibrpipe.config import StageConfig
from ibrpipe.types import Camera, Frame
from ibrpipe.types.renderable import Renderable


class PreparedData(Protocol):
    """What a renderer builds once of its sources; frames are drawn of nothing else."""

    @property
    def bytes(self) -> int:
        """Bytes held beyond the sources."""
        ...


class RendererOptions(StageConfig):
    """Options of a renderer. Values are taken as they are: no text for a number, no NaN, no infinity.

    Every field has a default, bounds or a Literal, and a description with its unit: the check in Python and on the
    command line, ``--help``, the JSON Schema and the table on the renderer's page are made of them.
    """

    model_config = ConfigDict(strict=True, allow_inf_nan=False, arbitrary_types_allowed=True)

    threads: int = Field(
        default=0, ge=0, le=4096, description="Number of threads; 0 = all. Never changes a byte of the result"
    )

    samples: Literal[1, 4, 9, 16, 64, "adaptive"] = Field(
        default=1, description="Rays of a pixel; adaptive = one, and several where a pixel shows an edge"
    )


Data = TypeVar("Data", bound=PreparedData)
Chosen = TypeVar("Chosen", bound=StageConfig)


class Renderer(ABC, Generic[Data, Chosen]):
    """A renderer; the registry keeps the class, and makes an instance without arguments for every call.

    Attributes
    ----------
    name : str
        As it is called; lower-case letters, digits, ``-`` and ``_``.
    summary, paper, limits : str
        One sentence each: what it does, where it comes from, what it cannot do.
    accepts : tuple of type
        Kinds of source that it renders; `Asset` among them says that it renders the textures of assets.
    Options : type
        Its options, usually a `RendererOptions`.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    paper: ClassVar[str]
    limits: ClassVar[str]
    accepts: ClassVar[tuple[type, ...]]
    Options: ClassVar[type[StageConfig]]

    @abstractmethod
    def prepare(self, sources: tuple[Any, ...]) -> Data:
        """Build once what drawing needs of `sources`, at least one, each of a kind in `accepts`.

        Raises
        ------
        RendererError
            A source cannot be rendered though its kind is accepted: too large, a perspective frame, ...
        """

    @abstractmethod
    def draw(self, data: Data, camera: Camera, outputs: tuple[str, ...], options: Chosen) -> Frame:
        """Draw one frame of what `prepare` built.

        Parameters
        ----------
        data : what `prepare` returned
        camera : Camera
        outputs : names among "color", "depth", "alpha"
            What is not named is not computed, and None in the frame.
        options : an instance of `Options`, checked

        Returns
        -------
        Frame
            Colour (H, W, 3) linear, depth (H, W) along camera z with +inf where nothing is hit, alpha (H, W); float32.
        """

    def draw_adaptive(self, data: Data, camera: Camera, outputs: tuple[str, ...], options: Chosen) -> Frame:
        """Draw as `draw`, with several rays where a pixel shows an edge; colour or alpha is asked for.

        This draws the whole picture with several rays a pixel, and takes of it what lies at edges; renderers that can
        draw some pixels alone have a quicker way of their own.
        """
        from ibrpipe.renderers.antialiasing import smooth_edges

        return smooth_edges(lambda view, wanted: self.draw(data, view, wanted, options), camera, outputs)


def type_names(types: Sequence[type]) -> list[str]:
    """Return the names of kinds of source, as messages and `ibrpipe.renderers` give them."""
    return [each.__name__ for each in types]


__all__ = ["PreparedData", "Renderable", "Renderer", "RendererOptions", "type_names"]
