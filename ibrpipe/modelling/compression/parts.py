"""One part of an asset coded at some levels and measured, the rest as it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ibrpipe.engine.executor import cores
from ibrpipe.io.assets import AssetIndex, component_bytes
from ibrpipe.io.components import Component, ComponentFiles, find_kind
from ibrpipe.io.layer_pictures.partly import coded_partly
from ibrpipe.io.recoding import holds_own, shared_files, shared_through_files, through_files
from ibrpipe.modelling.compression.steps import ANCHORS, FACTORS, LADDERS, CodingStep, Level, step_of
from ibrpipe.modelling.compression.tradeoff import Curve, filled
from ibrpipe.types import Asset, Reflection, Texture, ViewDependence
from ibrpipe.types.view_dependence import SharedData

#: mean square, of colours from 0 to 1, that a level adds at least: what seems to mend something is chance, and tells
#: nothing of coarser levels
LEAST_ERROR = 1e-9
#: PSNR of an asset, dB; None = nothing shows it
Measure = Callable[[Asset], float | None]
#: bytes of a part that is kept exactly, by those of its finest level that is measured; not coded, because that is slow
_EXACT = {"color": 5.0, "depth": 4.0, "normal": 8.0}


@dataclass(frozen=True, eq=False)
class Source:
    """An asset: its folder, and what was read there."""

    folder: Path
    index: AssetIndex
    asset: Asset


class Parts:
    """What an asset consists of, and what each part of it costs and loses when it is coded."""

    def __init__(self, source: Source, measure: Measure, before: float) -> None:
        self._source, self._index, self._asset = source.folder, source.index, source.asset
        self._measure, self._error = measure, square(before)

    def names(self) -> list[str]:
        """Return the parts that this asset has."""
        kinds = self._asset.kinds
        some = {"weights": self._weighted, "components": any(kind != Reflection.kind for kind in kinds)}
        return [name for name in LADDERS if some.get(name, True)]

    def coarsest(self, name: str) -> int:
        """Return the coarsest level of a part that may be taken.

        Colours that photos hide are still what exports and pictures without view dependence show.
        """
        hidden = name == "color" and any(shared_files(kind) is not None for kind in self._asset.kinds)
        return ANCHORS[name][-1] if hidden else len(LADDERS[name]) - 1

    @property
    def _weighted(self) -> bool:
        return any(
            isinstance(part, Reflection) and part.weights is not None
            for texture in self._asset.textures
            for part in texture.components
        )

    def curve(self, name: str, ladder: Sequence[Level], anchors: Sequence[int]) -> Curve:
        """Return the curve of one part over its ladder; `anchors` are measured. No level errs less than a finer one."""
        sizes, errors = [], []
        for level in anchors:
            asset, size = self.coded(step_of([ladder[level]]))
            sizes.append(max(float(size), 1.0))
            errors.append(max(square(self._measure(asset)) - self._error, LEAST_ERROR))
        factors = FACTORS.get(name, (1.0, 1.0))
        growing = np.maximum.accumulate(filled(len(ladder), anchors, errors, factors[1]))
        found = Curve(filled(len(ladder), anchors, sizes, factors[0]), growing)
        if not ladder[0]:
            found.errors[0], found.sizes[0] = 0.0, self._exact(name, sizes[0])
        return found

    def _exact(self, name: str, finest: float) -> float:
        if name in _EXACT:
            return _EXACT[name] * finest
        own = [
            told
            for entry in self._index.textures
            for told in entry.components
            if (told.kind == Reflection.kind) == (name == "weights")
        ]
        own += [told for told in self._index.shared if name == "components" and shared_files(told.kind) is not None]
        return float(sum(component_bytes(told, self._source) for told in own))

    def coded(self, step: CodingStep) -> tuple[Asset, int]:
        """Return the asset as it comes back where only what the step names is coded, and the bytes of that."""
        with ThreadPoolExecutor(cores()) as pool, TemporaryDirectory(prefix="ibrpipe-") as folder:
            numbers, shared = range(len(self._asset.textures)), self._shared(step, Path(folder) / "shared")
            done = list(
                pool.map(lambda number: self._texture(number, step, Path(folder) / str(number), shared), numbers)
            )
        size = sum(size for _, size in done) + sum(size for _, size in shared.values())
        return Asset(tuple(texture for texture, _ in done), self._asset.info), size

    def _shared(self, step: CodingStep, folder: Path) -> dict[str, tuple[SharedData, int]]:
        """What components share, by kind, and its bytes, where the step codes it anew with fewer."""
        found = {}
        for told in self._index.shared:
            quality, before = step.quality_of(told.kind), component_bytes(told, self._source)
            if quality is None or shared_files(told.kind) is None:
                continue
            data = self._asset.shared[told.kind]
            fresh, size = shared_through_files(data, told.kind, folder / told.kind, quality)
            found[told.kind] = (fresh, size) if size < before else (data, before)
        return found

    def _texture(
        self, number: int, step: CodingStep, folder: Path, shared: Mapping[str, tuple[SharedData, int]]
    ) -> tuple[Texture, int]:
        texture, entry = self._asset.textures[number], self._index.textures[number]
        layers, size = coded_partly(texture.layers, step.layers)
        components: list[ViewDependence] = []
        for told, part in zip(entry.components, texture.components, strict=True):
            quality, before = step.quality_of(part.kind), component_bytes(told, self._source)
            if part.kind in shared:
                components.append(_of_shared(told, shared[part.kind][0], self._source))
                continue
            if quality is None or not holds_own(part):
                components.append(part)
                continue
            fresh, own = through_files(part, texture.layers, folder / part.kind, quality)
            components.append(fresh if own < before else part)
            size += min(own, before)
        return Texture(layers, tuple(components)), size


def _of_shared(told: Component, shared: SharedData, folder: Path) -> ViewDependence:
    """Return a component that its entry tells of, on other shared data."""
    files: ComponentFiles = find_kind(told.kind).part("files", ComponentFiles)
    return files.read(told, folder, shared)


def square(psnr: float | None) -> float:
    """Mean square of errors, of colours from 0 to 1, that a PSNR stands for."""
    return float(10 ** (-0.1 * (psnr or 0.0)))


def curves_of(parts: Parts, fixed: Mapping[str, Level]) -> dict[str, Curve]:
    """Return the curves of all parts; one whose level is fixed has only that."""
    found = {}
    for name in parts.names():
        ladder, anchors = LADDERS[name][: parts.coarsest(name) + 1], ANCHORS[name]
        if name in fixed:
            ladder, anchors = (fixed[name],), (0,)
        found[name] = parts.curve(name, ladder, anchors)
    return found
