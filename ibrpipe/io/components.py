"""The kinds of view dependence: what each is called, and where it is stored, drawn and fitted.

A kind is one `ComponentKind`, made known by `register` or, from another package, by an entry point of the group
`GROUP`, ``name = "module:KIND"``. Its parts may be classes or texts ``module:Class``, imported when first needed.
How to add a kind stands in ``docs/new-component.md``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Literal, Protocol, runtime_checkable

from pydantic import ConfigDict, Field, SerializerFunctionWrapHandler, model_serializer

from ibrpipe.config import Document
from ibrpipe.errors import ConfigError
from ibrpipe.types import LayeredDepthImage, ViewDependence
from ibrpipe.types.view_dependence import SharedData

GROUP = "ibrpipe.components"

PartName = Literal["files", "drawing", "fitting"]


class Component(Document):
    """One way in which a texture's colour depends on the view, or what such components share."""

    model_config = ConfigDict(extra="allow")

    kind: str = Field(description="spiral: residual images on spiral directions; more kinds may join")
    file: str | None = Field(None, description="Path below the asset folder")
    files: tuple[str, ...] = Field((), description="Paths below the asset folder, where there are several")

    @property
    def paths(self) -> tuple[str, ...]:
        """All its files, below the asset folder."""
        return (*([] if self.file is None else [self.file]), *self.files)

    @model_serializer(mode="wrap")
    def _said(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out `file` or `files` where there is none."""
        return {key: value for key, value in handler(self).items() if key not in ("file", "files") or value}

    def below(self, folder: str) -> Component:
        """Return the same with paths that begin with `folder`, below which they lie."""
        moved: dict[str, Any] = {} if self.file is None else {"file": f"{folder}/{self.file}"}
        moved |= {"files": tuple(f"{folder}/{file}" for file in self.files)} if self.files else {}
        return self.model_copy(update=moved)


@runtime_checkable
class ComponentFiles(Protocol):
    """How one kind is stored; made without arguments. What the components of a kind share is stored once."""

    def write(self, component: Any, folder: Path, quality: int) -> Mapping[str, Any]:
        """Write a component into the folder of its texture.

        Parameters
        ----------
        quality : int
            1 to 100; 100 is lossless.

        Returns
        -------
        mapping
            What the index says of it besides its kind: ``file`` or ``files``, named from `folder` on, and plain values.
        """

    def read(self, entry: Component, root: Path, shared: Any) -> ViewDependence:
        """Read a component; `entry` is what the index says, `root` its folder, `shared` what `read_shared` returned.

        Raises
        ------
        MissingFileError, FormatError
            A file is missing or damaged, or the entry lacks something.
        """

    def write_shared(self, shared: Any, folder: Path, quality: int) -> Mapping[str, Any]:
        """Write what all components of the kind share into the asset's folder; returns as `write`."""
        raise ConfigError(f"{type(self).__name__} cannot write shared data; give it write_shared and read_shared")

    def read_shared(self, entry: Component, root: Path) -> SharedData:
        """Read what all components of the kind share."""
        raise ConfigError(f"{type(self).__name__} cannot read shared data; give it write_shared and read_shared")


@runtime_checkable
class SampleFiles(ComponentFiles, Protocol):
    """How a kind is stored whose components hold numbers for every sample of the layers: compactly, beside these."""

    def write_on(
        self, component: Any, layers: LayeredDepthImage, folder: Path, quality: int, speed: int
    ) -> Mapping[str, Any]:
        """Write as `write` does, but as a reader can who has the layers.

        Parameters
        ----------
        layers : LayeredDepthImage
            As a reader will find them: which texels have how many samples is certain, other values may be coarser.
        speed : int
            As `ibrpipe.io.layer_pictures.avif.encode_avif` takes it.
        """

    def read_on(self, entry: Component, root: Path, shared: Any, layers: LayeredDepthImage) -> ViewDependence:
        """Read what `write_on` or `write` wrote."""


@runtime_checkable
class SharedFiles(ComponentFiles, Protocol):
    """How a kind is stored whose bytes lie in what its components share: that is coded anew as a whole."""

    def recode_shared(self, shared: Any, folder: Path, quality: int, speed: int) -> Mapping[str, Any]:
        """Write what all components share as `write_shared` does.

        Parameters
        ----------
        speed : int
            As `ibrpipe.io.layer_pictures.avif.encode_avif` takes it.
        """


@dataclass(frozen=True)
class ComponentKind:
    """A kind of view dependence.

    Attributes
    ----------
    name : str
        Lower-case letters, digits, ``-`` and ``_``; what `ViewDependence.kind` and ``asset.json`` say.
    summary : str
        One sentence.
    files : type or str
        `ComponentFiles`.
    drawing : type or str
        `ibrpipe.renderers.view_dependence.component.ComponentDrawer`.
    fitting : type, str or None
        `ibrpipe.modelling.view_dependence.fitter.Fitter`; None = the pipeline cannot make such components.
    """

    name: str
    summary: str
    files: type | str
    drawing: type | str
    fitting: type | str | None = None

    def part(self, name: PartName, contract: type) -> Any:
        """Return one of the parts, imported and made: an instance of the protocol `contract`.

        Raises
        ------
        ConfigError
            The kind has no such part, it cannot be imported, or it does not keep the contract.
        """
        stated = getattr(self, name)
        if stated is None:
            raise ConfigError(f"view dependence of kind {self.name!r} has no {name}; its package must bring it")
        made = (_imported(self.name, stated) if isinstance(stated, str) else stated)()
        if not isinstance(made, contract):
            raise ConfigError(
                f"{name} of kind {self.name!r} is {type(made).__name__}, which is no {contract.__name__}; "
                f"see {contract.__module__}"
            )
        return made


def _imported(kind: str, stated: str) -> Any:
    module, _, attribute = stated.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"kind {kind!r} cannot be loaded from {stated}: {error}") from error


_known: dict[str, ComponentKind] = {}


def register(kind: ComponentKind) -> None:
    """Make a kind known in this process.

    Raises
    ------
    ConfigError
        The name has another form or belongs to another kind.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_-]*", kind.name):
        raise ConfigError(f"{kind.name!r} is no name of a kind; give lower-case letters, digits, - and _")
    if _known.get(kind.name, kind) != kind:
        raise ConfigError(f"there is view dependence of kind {kind.name!r} already; choose another name")
    _known[kind.name] = kind


register(
    ComponentKind(
        name="spiral",
        summary="Residual images on spiral directions (gong-yang).",
        files="ibrpipe.io.residuals:SpiralFiles",
        drawing="ibrpipe.renderers.view_dependence.spiral:SpiralDrawer",
        fitting="ibrpipe.modelling.view_dependence.spiral_fitter:SpiralFitter",
    )
)

register(
    ComponentKind(
        name="reflection",
        summary="Diffuse colours under tables of reflected light that all textures share.",
        files="ibrpipe.io.reflection:ReflectionFiles",
        drawing="ibrpipe.renderers.view_dependence.reflection:ReflectionDrawer",
        fitting="ibrpipe.modelling.view_dependence.reflection.fitter:ReflectionFitter",
    )
)

register(
    ComponentKind(
        name="photos",
        summary="Photos that are kept and blended anew for every view (buehler2001).",
        files="ibrpipe.io.kept_photos:PhotosFiles",
        drawing="ibrpipe.renderers.view_dependence.photos:PhotosDrawer",
        fitting="ibrpipe.modelling.view_dependence.photos_fitter:PhotosFitter",
    )
)


def known_kinds() -> tuple[str, ...]:
    """Return the names of all kinds, those of other packages last."""
    return tuple(dict.fromkeys((*_known, *_foreign())))


def find_kind(name: str) -> ComponentKind:
    """Return the kind called `name`.

    Raises
    ------
    ConfigError
        There is none, and the message names those that exist; or the package that brings it is broken.
    """
    if name in _known:
        return _known[name]
    if name in _foreign():
        return _from_package(_foreign()[name])
    raise ConfigError(
        f"no view dependence of kind {name!r} is known, only: {', '.join(known_kinds())}; "
        f"use a newer ibrpipe, or install the package that brings it (entry point {GROUP})"
    )


@cache
def _foreign() -> dict[str, EntryPoint]:
    """Return the entry points of other packages by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


@cache
def _from_package(entry: EntryPoint) -> ComponentKind:
    """Load the kind of another package; whatever is wrong with it becomes one line."""
    try:
        found = entry.load()
        if not isinstance(found, ComponentKind) or found.name != entry.name:
            raise TypeError(f"{entry.value} is no ComponentKind called {entry.name!r}")
    except Exception as error:  # foreign code may raise anything when it is imported
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise ConfigError(
            f"kind {entry.name!r} ({entry.value}) cannot be loaded ({told}); mend that package"
        ) from error
    return found
