"""Bring photos to one exposure and white balance, where what they show in common says that these differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from ibrpipe.capture.coverage import spread_points
from ibrpipe.capture.photometry import Gains, find_gains, gain_of, observe
from ibrpipe.config import StageConfig
from ibrpipe.core.color import luminance
from ibrpipe.embree import MeshCaster
from ibrpipe.engine.stage import Stage, StageOutputs, artifact
from ibrpipe.io.documents.photometry import PhotoGain, Photometry
from ibrpipe.io.documents.views import Views
from ibrpipe.io.surfaces.meshes import read_mesh
from ibrpipe.io.views import PHOTOMETRY, View, ViewSet, read_views, write_views
from ibrpipe.types import Array


class PhotometryConfig(StageConfig):
    """Settings of the photometry stage."""

    balance: Literal["auto", "always", "never"] = Field(
        "auto",
        description="Bring photos to one exposure and white balance. auto: where that explains min_explained of what "
        "they disagree by, and they differ by min_stops",
    )
    min_explained: float = Field(
        0.2, ge=0, le=1, description="Share of the photos' disagreement that factors of whole photos must explain"
    )
    min_stops: float = Field(0.03, ge=0, description="Root mean square of exposures, stops, below which all is well")
    samples: int = Field(8_000, ge=1000, le=10_000_000, description="Surface points that are compared")


@dataclass(frozen=True)
class Inputs:
    """What the photometry stage reads, and the folder that it fills."""

    views: Path
    mesh: Path
    out: Path


@dataclass(frozen=True)
class Outputs(StageOutputs):
    """The views with their gains, and why they have them."""

    views: Path = artifact("views.json", "views.json of the photometry stage.", Views)
    photometry: Path = artifact("photometry.json", "Factors of all photos, and why.", Photometry)


def run(inputs: Inputs, config: PhotometryConfig) -> Outputs:
    """Compare the photos on the mesh; write ``views.json``, ``photometry.json``, and ``summary.txt`` if they differ.

    Raises
    ------
    CaptureError, FormatError
        The views or the mesh cannot be read.
    """
    views, outputs = read_views(inputs.views), Outputs.below(inputs.out)
    document, balanced = Photometry(applied=False, why="set so", before=None, after=None, train=[], test=[]), views
    if config.balance != "never":
        document, balanced = _balance(views, MeshCaster(read_mesh(inputs.mesh)), config)
    write_views(replace(balanced, mesh=None), outputs.views)
    outputs.photometry.write_text(document.to_json() + "\n", encoding="utf-8")
    if document.applied:
        (inputs.out / "summary.txt").write_text(f"exposure and white balance: {document.why}\n", encoding="utf-8")
    return outputs


def _balance(views: ViewSet, caster: MeshCaster, config: PhotometryConfig) -> tuple[Photometry, ViewSet]:
    points = spread_points(caster.mesh, config.samples)
    gains = find_gains(observe(views.train, caster, points))
    applied, why = decide(gains, config)
    test = np.empty((0, 3))
    if applied and views.test:
        seen = observe(views.test, caster, points)
        test = np.stack([gain_of(seen[:, number], gains.colors) for number in range(len(views.test))])
    document = Photometry(
        applied=applied,
        why=why,
        before=_told(gains.before),
        after=_told(gains.after),
        train=_listed(views.train, gains.train),
        test=_listed(views.test, test) if applied else [],
    )
    if not applied:
        return document, views
    train, held_out = _multiplied(views.train, gains.train), _multiplied(views.test, test)
    return document, replace(views, train=train, test=held_out, info={**views.info, PHOTOMETRY: why})


def decide(gains: Gains, config: PhotometryConfig) -> tuple[bool, str]:
    """Say whether photos are brought together, and why."""
    if not np.isfinite(gains.before):
        return False, "photos show too little in common to compare them"
    why = (
        f"photos disagree about their common surface by {gains.before:.3f} stops, by {gains.after:.3f} once exposures "
        f"({gains.stops:.2f} stops apart) and white balances are undone"
    )
    if config.balance == "always":
        return True, f"set so; {why}"
    if gains.stops < config.min_stops:
        return False, f"{why}; less than {config.min_stops} stops are left alone"
    if gains.explained < config.min_explained:
        return False, f"{why}; that is not {100 * config.min_explained:.0f} % less: the surface differs, not the photos"
    return True, why


def _told(value: float) -> float | None:
    return round(value, 4) if np.isfinite(value) else None


def _listed(views: Sequence[View], factors: Array) -> list[PhotoGain]:
    return [
        PhotoGain(
            name=view.name,
            stops=round(-float(np.log2(luminance(each))), 4),
            factors=(round(float(each[0]), 5), round(float(each[1]), 5), round(float(each[2]), 5)),
        )
        for view, each in zip(views, factors, strict=True)
    ]


def _multiplied(views: Sequence[View], factors: Array) -> tuple[View, ...]:
    return tuple(
        replace(view, white_balance=(float(red), float(green), float(blue)))
        for view, (red, green, blue) in zip(views, factors * [view.white_balance for view in views], strict=True)
    )


STAGE = Stage(
    name="photometry",
    summary="Bring photos to one exposure and white balance, where these differ.",
    inputs=Inputs,
    outputs=Outputs,
    config=PhotometryConfig,
    run=run,
    example="ibrpipe photometry --views out/ingest/views.json --mesh out/geometry/mesh.ply --out out",
)
