"""Code the finished asset compactly, as coarsely as a target allows, measured on training photos."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import numpy as np
from pydantic import Field, model_validator

from ibrpipe.config import StageConfig
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.evaluation.photo_fit import PhotoFit, mean_of
from ibrpipe.evaluation.sizes import photo_bytes
from ibrpipe.evaluation.texture_errors import texture_errors
from ibrpipe.io.assets import INDEX, AssetIndex, read_asset, read_index
from ibrpipe.io.recoding import finish, losses, texture_bytes
from ibrpipe.io.views import View, ViewSet, read_views
from ibrpipe.modelling.compression.between import between_photos
from ibrpipe.modelling.compression.coarser import write_coarser
from ibrpipe.modelling.compression.coder import Coder, size_of
from ibrpipe.modelling.compression.document import Compression, PartLevel, Trial
from ibrpipe.modelling.compression.parts import Parts, Source, curves_of, square
from ibrpipe.modelling.compression.search import coarsest_within, finest_within
from ibrpipe.modelling.compression.steps import ANCHORS, LADDERS, CodingStep, Level
from ibrpipe.modelling.compression.tradeoff import Curve, choices, finer_while_worth, step_of_choice

#: bytes of a megabyte
_MB = 1e6
#: bytes of what is told at last of the whole and of each texture, at the most
_TOLD, _TOLD_EACH = 3000, 1500
#: texels that are joined along either edge, where a size cannot be kept otherwise
_FACTORS = (1, 2, 4, 8)
#: photos by which single parts are measured, at the most
_FEW = 6
#: settings that fix a part: name of the setting to name in a level
_SETTINGS: Mapping[str, Mapping[str, str]] = {
    "color": {"color_quality": "color_quality"},
    "depth": {"depth_step": "depth_step"},
    "normal": {name: name for name in ("normal_quality", "normal_bits", "normal_tolerance")},
    "weights": {"weight_quality": "weights"},
    "components": {"component_quality": "components"},
}

#: settings that need photos
_MEASURED = ("target_mb", "target_db", "loss_db", *(name for names in _SETTINGS.values() for name in names))

logger = logging.getLogger(__name__)


class CompressConfig(StageConfig):
    """Settings of the compress stage."""

    lossless: bool = Field(False, description="Keep every bit of the layers, and view dependence as it is")
    target_mb: float | None = Field(None, gt=0, description="Largest size of the asset, megabytes")
    target_db: float | None = Field(None, gt=0, le=100, description="Least PSNR of the measured training photos, dB")
    loss_db: float = Field(
        0.5, ge=0, le=100, description="Without a target: PSNR of the measured training photos that may be lost, dB"
    )
    worth_db: float = Field(
        0.15,
        gt=0,
        description="Without a target: PSNR of the measured training photos that a further hundredth of the photos' "
        "bytes must bring to be spent, dB",
    )
    measured_views: int = Field(12, ge=1, le=1000, description="Training photos that are measured, evenly spread")
    joined_texels: int | None = Field(
        None, ge=1, le=16, description="So many texels along either edge become one first; none = as target_mb needs"
    )
    color_quality: int | None = Field(None, ge=1, le=100, description="Quality of colours; none = chosen")
    depth_step: float | None = Field(
        None, gt=0, le=1, description="Step of depths, shares of a texel's pitch; none = chosen"
    )
    normal_quality: int | None = Field(
        None, ge=1, le=100, description="AVIF quality of normals, told as differences from depth's; none = chosen"
    )
    normal_bits: int | None = Field(
        None, ge=3, le=16, description="Instead of a quality: bits of either coordinate of normals"
    )
    normal_tolerance: float | None = Field(
        None,
        gt=0,
        le=180,
        description="With normal_bits: degrees within which normals had from depth will do",
    )
    weight_quality: int | None = Field(
        None, ge=1, le=99, description="AVIF quality of the weights of shared reflection; none = chosen"
    )
    component_quality: int | None = Field(
        None, ge=1, le=99, description="AVIF quality of residual images; none = chosen"
    )

    @model_validator(mode="after")
    def _one_target(self) -> Self:
        named = [name for name in ("lossless", "target_mb", "target_db") if getattr(self, name)]
        if len(named) > 1:
            raise ValueError(f"{' and '.join(named)} cannot both be kept; give one")
        settings = [name for names in _SETTINGS.values() for name in names]
        settings.append("joined_texels")
        given = [name for name in settings if getattr(self, name) is not None]
        if self.lossless and given:
            raise ValueError(f"lossless leaves no choice of {given[0]}; give one of the two")
        if self.normal_bits is not None and self.normal_quality is not None:
            raise ValueError("normal_bits and normal_quality cannot both be kept; give one")
        if self.normal_tolerance is not None and self.normal_bits is None:
            raise ValueError("normal_tolerance needs normal_bits; give both")
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


@dataclass(frozen=True)
class Goal:
    """What coding starts from.

    Attributes
    ----------
    before : float
        PSNR of the measured photos without coding, dB.
    ahead : float
        How much better views between photos are shown, dB: what is lost there counts.
    """

    before: float
    ahead: float = 0.0

    def allowed(self, config: CompressConfig) -> float:
        """Mean square that coding may add, of colours from 0 to 1."""
        if config.target_db is not None:
            return square(config.target_db) - square(self.before)
        between = self.before + self.ahead
        return square(between - config.loss_db) - square(between)

    def least(self, config: CompressConfig) -> float:
        """PSNR of the measured photos with as much added, dB."""
        return float(-10 * np.log10(max(square(self.before) + self.allowed(config), 1e-10)))


def run(inputs: Inputs, config: CompressConfig) -> Outputs:
    """Measure what every part of the asset weighs and costs, and write it in the coding that the target asks for.

    Raises
    ------
    MissingFileError, FormatError
        The asset or the views cannot be read.
    """
    views = read_views(inputs.views)
    first = Source(inputs.asset, read_index(inputs.asset), read_asset(inputs.asset))
    fit = PhotoFit(_spread(views.train, config.measured_views), first.asset)
    each, every = fit.each(first.asset), max(1, -(-len(fit.views) // _FEW))
    before, few = mean_of(each), mean_of(each[::every])
    goal = None if before is None else Goal(before, between_photos(first.asset, lambda asset: fit.psnr(asset, every)))
    with TemporaryDirectory(prefix="ibrpipe-") as scratch:
        for factor in _factors(config):
            folder = Path(scratch) / str(factor)
            source = first if factor == 1 else write_coarser(first, factor, folder)
            coder = Coder(source, fit.psnr, inputs.out)
            few = few if factor == 1 or before is None else fit.psnr(source.asset, every)
            parts = Parts(source, lambda changed: fit.psnr(changed, every), few or 0.0)
            step, why, found, told_parts = _choose(coder, parts, config, goal, photo_bytes(views.train))
            if found:
                break
        chosen = coder.settle(step, lambda trial: _kept(trial, config, goal, len(first.index.textures)))
        told = Compression(
            why=why if factor == 1 else f"{why}; {factor} x {factor} texels are joined",
            chosen=chosen,
            joined_texels=factor,
            bytes_before=size_of(inputs.asset),
            psnr_before=_rounded(before),
            psnr_between=None if goal is None or not goal.ahead else _rounded(goal.before + goal.ahead),
            views=[view.name for view in fit.views],
            parts=told_parts,
            trials=coder.trials,
        )
        _finish(coder, views, told, first)
    return Outputs.below(inputs.out)


def _factors(config: CompressConfig) -> tuple[int, ...]:
    """Return by how much coarser texels are tried, until the target is met."""
    if config.joined_texels is not None:
        return (config.joined_texels,)
    return _FACTORS if config.target_mb is not None else (1,)


def _most(megabytes: float, textures: int) -> int:
    """Return the bytes that coding may take, so that with what is told of its losses and errors the size is kept."""
    return int(megabytes * _MB) - _TOLD - textures * _TOLD_EACH


def _kept(trial: Trial, config: CompressConfig, goal: Goal | None, textures: int) -> bool:
    """Say whether a coding keeps what is asked for."""
    if config.target_mb is not None:
        return trial.bytes <= _most(config.target_mb, textures)
    return trial.psnr is None or goal is None or trial.psnr >= goal.least(config)


def _fixed(config: CompressConfig) -> dict[str, Level]:
    """Return the levels that the settings leave no choice about."""
    given = {name: getattr(config, name) for name in CompressConfig.model_fields if getattr(config, name) is not None}
    found: dict[str, Level] = {
        part: {name: given[setting] for setting, name in names.items() if setting in given}
        for part, names in _SETTINGS.items()
    }
    return {part: level for part, level in found.items() if level}


def _choose(
    coder: Coder, parts: Parts, config: CompressConfig, goal: Goal | None, photos: int
) -> tuple[CodingStep, str, bool, dict[str, list[PartLevel]]]:
    """Return the step to take, why, whether it keeps the target, and what the parts weigh and cost.

    `photos` is the bytes of the training photos.
    """
    if config.lossless:
        return CodingStep(), "every bit of the layers is kept, view dependence as it was", True, {}
    if goal is None:
        why = "no photo shows the asset, so that nothing can be measured: every bit is kept"
        asked = [name for name in _MEASURED if name in config.model_fields_set and getattr(config, name) is not None]
        if asked:
            logger.warning(f"{coder.source.folder}: {why}, whatever {', '.join(asked)} may say")
        return CodingStep(), why, True, {}
    fixed = _fixed(config)
    curves = curves_of(parts, fixed)
    ladder = choices(curves)
    steps = [step_of_choice(choice, fixed) for choice in ladder]
    told = {name: _told(name, curve, goal.before, fixed) for name, curve in curves.items()}

    def attempt(index: int) -> tuple[int, float]:
        trial = coder.tried(steps[index])
        return trial.bytes, square(trial.psnr) - square(goal.before)

    if config.target_mb is not None:
        found = finest_within(ladder, _most(config.target_mb, len(coder.source.index.textures)), attempt)
        if found is None:
            return steps[-1], f"even the coarsest coding is larger than {config.target_mb:g} MB", False, told
        return steps[found], f"the finest coding of at most {config.target_mb:g} MB", True, told
    found = coarsest_within(ladder, goal.allowed(config), attempt)
    if found is None:
        how = "with the settings given" if fixed or config.joined_texels else "even without losses"
        step = steps[0] if fixed else CodingStep()
        return step, f"{how} the photos are not shown at {goal.least(config):.2f} dB", False, told
    if config.target_db is not None:
        why = f"the coarsest coding that shows the measured photos at {config.target_db:g} dB or better"
        return steps[found], why, True, told
    where = " between photos, as left-out photos tell" if goal.ahead else " on the measured photos"
    why = f"the coarsest coding that loses at most {config.loss_db:g} dB{where}"
    finer = finer_while_worth(
        ladder, found, square(goal.before + goal.ahead), config.worth_db / (0.01 * max(photos, 1))
    )
    if finer < found:
        why += f", and what is worth its bytes: {config.worth_db:g} dB for each further hundredth of the photos'"
    return steps[finer], why, True, told


def _told(name: str, curve: Curve, before: float, fixed: Mapping[str, Level]) -> list[PartLevel]:
    """Return what was measured of one part."""
    ladder, levels = ((fixed[name],), (0,)) if name in fixed else (LADDERS[name], ANCHORS[name])
    return [
        PartLevel(
            level=dict(ladder[level]),
            bytes=int(curve.sizes[level]),
            psnr_change=round(-10 * float(np.log10(max(square(before) + curve.errors[level], 1e-10))) - before, 3),
        )
        for level in levels
    ]


def _finish(coder: Coder, views: ViewSet, told: Compression, first: Source) -> None:
    """Write the index with what every texture lost and errs, and `compression.json`."""
    index, coded = read_index(coder.out), read_asset(coder.out)
    errors = texture_errors(coded, views, [texture.layers.observers for texture in coder.source.asset.textures])
    lost: list[dict[str, Any]] = []
    for i, (old, new) in enumerate(zip(coder.source.asset.textures, coded.textures, strict=True)):
        sizes = [texture_bytes(first.index.textures[i], first.folder), texture_bytes(index.textures[i], coder.out)]
        figures = {"bytes_before": sizes[0], "bytes": sizes[1], **losses(old.layers, new.layers)}
        lost.append(figures | ({"joined_texels": told.joined_texels} if told.joined_texels > 1 else {}))
    summary = {"why": told.why, "psnr_before": told.psnr_before, "psnr": told.chosen.psnr}
    finish(index, coder.out, lost, summary, errors)
    (coder.out / "compression.json").write_text(told.to_json(), encoding="utf-8")


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)


def _spread(views: tuple[View, ...], count: int) -> list[View]:
    """Return at most `count` views, evenly spread."""
    numbers = np.unique(np.linspace(0, len(views) - 1, min(count, len(views))).round().astype(int))
    return [views[number] for number in numbers] if views else []


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
