"""Code the finished asset compactly, as coarsely as a target allows, measured on training photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import Field, model_validator

from ibrpipe.config import StageConfig
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.evaluation.photo_fit import PhotoFit
from ibrpipe.io.assets import INDEX, AssetIndex, files_of, read_asset, read_index
from ibrpipe.io.manifest import files_below
from ibrpipe.io.recoding import finish, losses, recode, texture_bytes
from ibrpipe.io.views import View, read_views
from ibrpipe.modelling.compression.document import Compression, Trial
from ibrpipe.modelling.compression.steps import NORMALS, STEPS, CodingStep, coarsest, finest, keep_normals
from ibrpipe.types import Asset

#: bytes of a megabyte
_MB = 1e6
#: PSNR that normals had from depth may cost, dB
_NORMALS_DB = 0.03
#: settings that are those of `Coding`
_LAYERS = ("color_quality", "depth_step", "normal_bits", "normal_tolerance")


class CompressConfig(StageConfig):
    """Settings of the compress stage."""

    lossless: bool = Field(False, description="Keep every bit of the layers, and view dependence as it is")
    target_mb: float | None = Field(None, gt=0, description="Largest size of the asset, megabytes")
    target_db: float | None = Field(None, gt=0, le=100, description="Least PSNR of the measured training photos, dB")
    loss_db: float = Field(
        0.15, ge=0, le=100, description="Without a target: PSNR of the measured training photos that may be lost, dB"
    )
    measured_views: int = Field(12, ge=1, le=1000, description="Training photos that are measured, evenly spread")
    color_quality: int | None = Field(None, ge=1, le=100, description="JPEG XL quality of colours; none = chosen")
    depth_step: float | None = Field(
        None, gt=0, le=1, description="Step of depths, shares of a texel's pitch; none = chosen"
    )
    normal_bits: int | None = Field(
        None, ge=3, le=16, description="Bits of either coordinate of normals; none = chosen"
    )
    normal_tolerance: float | None = Field(
        None, gt=0, le=180, description="Normals are had from depth where right within so many degrees; none = chosen"
    )
    component_quality: int | None = Field(
        None, ge=1, le=99, description="Quality of residual images, as WebP's; none = chosen"
    )

    @model_validator(mode="after")
    def _one_target(self) -> Self:
        named = [name for name in ("lossless", "target_mb", "target_db") if getattr(self, name)]
        if len(named) > 1:
            raise ValueError(f"{' and '.join(named)} cannot both be kept; give one")
        given = [name for name in (*_LAYERS, "component_quality") if getattr(self, name) is not None]
        if self.lossless and given:
            raise ValueError(f"lossless leaves no choice of {given[0]}; give one of the two")
        return self


@dataclass(frozen=True)
class Inputs:
    """The asset, the views it was made from, and the folder to write to."""

    asset: Path
    views: Path
    out: Path


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """The asset, coded compactly, and what was chosen."""

    asset: Path = artifact("", "Asset folder, coded compactly.")
    index: Path = artifact(INDEX, "Index of the asset.", AssetIndex)
    compression: Path = artifact("compression.json", "How the asset is coded, and why.", Compression)


@dataclass
class _Coder:
    """Codes an asset in several ways and measures what comes of it."""

    source: Path
    index: AssetIndex
    asset: Asset
    fit: PhotoFit
    out: Path
    trials: list[Trial] = field(default_factory=list)

    def coded(self, step: CodingStep) -> tuple[AssetIndex, Asset]:
        """Write the asset into `out`, where no other one remains, and read it."""
        if (self.out / INDEX).is_file():
            for name in files_of(read_index(self.out)):
                (self.out / name).unlink(missing_ok=True)
        index = recode(self.source, self.index, self.asset, self.out, step.layers, step.components)
        finish(index, self.out, [{}] * len(index.textures))
        return index, read_asset(self.out)

    def tried(self, step: CodingStep, photos: bool) -> Trial:
        """Code the asset and measure it, the photos too if asked for."""
        _, asset = self.coded(step)
        trial = Trial(
            layers=step.layers,
            component_quality=step.components,
            bytes=_size(self.out),
            psnr=_rounded(self.fit.psnr(asset)) if photos else None,
        )
        self.trials.append(trial)
        return trial

    def settled(self, step: CodingStep) -> Trial:
        """Leave the asset coded in this step, measured on the photos; not once more where it was the last one tried."""
        last = self.trials[-1] if self.trials else None
        if last is None or CodingStep(last.layers, last.component_quality) != step:
            last = self.tried(step, photos=True)
            self.trials.pop()
        psnr = last.psnr if last.psnr is not None else _rounded(self.fit.psnr(read_asset(self.out)))
        return last.model_copy(update={"psnr": psnr})


def run(inputs: Inputs, config: CompressConfig) -> Outputs:
    """Try codings from exact to coarse by bisection and write the asset in the one that the target asks for.

    Raises
    ------
    MissingFileError, FormatError
        The asset or the views cannot be read.
    """
    index, asset = read_index(inputs.asset), read_asset(inputs.asset)
    fit = PhotoFit(_spread(read_views(inputs.views).train, config.measured_views))
    coder = _Coder(inputs.asset, index, asset, fit, inputs.out)
    before = _rounded(fit.psnr(asset))
    steps = [_settled(step, config) for step in _steps(coder, config, before)]
    chosen, why = _choose(coder, steps, config, before)
    trial = coder.settled(steps[chosen])
    told = Compression(
        why=why,
        chosen=trial,
        bytes_before=_size(inputs.asset),
        psnr_before=before,
        views=[view.name for view in fit.views],
        trials=coder.trials,
    )
    _finish(coder, inputs, told)
    return Outputs.below(inputs.out)


def _steps(coder: _Coder, config: CompressConfig, before: float | None) -> Sequence[CodingStep]:
    """Return the steps to choose from; normals are had from depth only where the photos do not miss them."""
    if config.lossless or before is None:
        return STEPS[:1]
    if config.normal_tolerance is not None:
        return STEPS
    derived = coder.tried(NORMALS, photos=True).psnr
    lost = before - (derived or 0.0)
    return STEPS if lost <= _NORMALS_DB else [keep_normals(step) for step in STEPS]


def _settled(step: CodingStep, config: CompressConfig) -> CodingStep:
    """Return a step with what the settings leave no choice about."""
    if config.lossless:
        return step
    given = {name: getattr(config, name) for name in _LAYERS if getattr(config, name) is not None}
    return CodingStep(step.layers.model_copy(update=given), config.component_quality or step.components)


def _choose(
    coder: _Coder, steps: Sequence[CodingStep], config: CompressConfig, before: float | None
) -> tuple[int, str]:
    """Return the place of the step to take, and why."""
    if config.lossless:
        return 0, "every bit of the layers is kept, view dependence as it was"
    if config.target_mb is not None:
        most = config.target_mb * _MB
        small = cache(lambda i: coder.tried(steps[i], photos=False).bytes <= most)
        found = finest(len(steps), small)
        if found is None:
            return len(steps) - 1, f"even the coarsest coding is larger than {config.target_mb:g} MB"
        return found, f"the finest coding of at most {config.target_mb:g} MB"
    wanted = config.target_db if config.target_db is not None else None if before is None else before - config.loss_db
    if wanted is None:
        return 0, "no photo shows the asset, so that nothing can be measured: every bit is kept"
    good = cache(lambda i: (coder.tried(steps[i], photos=True).psnr or 0.0) >= wanted)
    found = coarsest(len(steps), good)
    if found is None:
        return 0, f"even without losses the photos are not shown at {wanted:.2f} dB"
    if config.target_db is not None:
        return found, f"the coarsest coding that shows the measured photos at {config.target_db:g} dB or better"
    return found, f"the coarsest coding that loses at most {config.loss_db:g} dB on the measured photos"


def _finish(coder: _Coder, inputs: Inputs, told: Compression) -> None:
    """Write the index with what every texture lost, and `compression.json`."""
    index, coded = read_index(inputs.out), read_asset(inputs.out)
    lost: list[dict[str, Any]] = []
    for i, (old, new) in enumerate(zip(coder.asset.textures, coded.textures, strict=True)):
        sizes = [texture_bytes(coder.index.textures[i], inputs.asset), texture_bytes(index.textures[i], inputs.out)]
        lost.append({"bytes_before": sizes[0], "bytes": sizes[1], **losses(old.layers, new.layers)})
    summary = {"why": told.why, "psnr_before": told.psnr_before, "psnr": told.chosen.psnr}
    finish(index, inputs.out, lost, summary)
    (inputs.out / "compression.json").write_text(told.to_json(), encoding="utf-8")


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in files_below(folder))


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)


def _spread(views: tuple[View, ...], count: int) -> list[View]:
    """Return at most `count` views, evenly spread."""
    places = np.unique(np.linspace(0, len(views) - 1, min(count, len(views))).round().astype(int))
    return [views[place] for place in places] if views else []


STAGE = Stage(
    name="compress",
    folder="asset",
    summary="Code the asset compactly, as coarsely as a size or an error allows.",
    inputs=Inputs,
    outputs=Outputs,
    config=CompressConfig,
    run=run,
    example="ibrpipe compress --out runs/vase --target-mb 0.5",
)
