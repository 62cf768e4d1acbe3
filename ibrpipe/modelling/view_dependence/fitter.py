"""Fitters: how the pipeline makes the components of one kind of all textures that the plan wants them for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from ibrpipe.config import StageConfig
from ibrpipe.io.components import Component, find_kind
from ibrpipe.modelling.plan_file import TexturePlan
from ibrpipe.modelling.view_dependence.residuals_file import Figures
from ibrpipe.modelling.view_dependence.work_units import Sources


@dataclass(frozen=True)
class FitJob:
    """What a fitter is given.

    Attributes
    ----------
    kind : str
    sources : Sources
        Views, mesh, plan and layers; `work_units.context_of` loads them.
    plans : sequence of TexturePlan
        All textures; those with a component of the kind are wanted, and it holds their settings.
    config : StageConfig
        Settings of the residuals stage.
    out : Path
        Folder that exists and that the fitter fills: ``texture_NN/`` for the files of a texture.
    """

    kind: str
    sources: Sources
    plans: Sequence[TexturePlan]
    config: StageConfig
    out: Path

    @property
    def wanted(self) -> list[int]:
        """Textures that shall get a component of the kind."""
        return [which for which, plan in enumerate(self.plans) if plan.component(self.kind)]

    def folder(self, which: int) -> Path:
        """Make and return the folder of one texture."""
        folder = self.out / f"texture_{which:02d}"
        folder.mkdir(parents=True, exist_ok=True)
        return folder


@dataclass(frozen=True)
class Fitted:
    """What a fitter has written.

    Attributes
    ----------
    figures : tuple of Figures
        One for each texture that has got a component; its `component` names the files from `FitJob.out` on.
    shared : Component or None
        What the components share, files named likewise.
    training_psnr : tuple of float
        PSNR of the training photos, dB, before every round of refinement and at last; empty = not measured.
    """

    figures: tuple[Figures, ...]
    shared: Component | None = None
    training_psnr: tuple[float, ...] = ()


@runtime_checkable
class Fitter(Protocol):
    """Fits the components of one kind to all textures at once; made without arguments."""

    def fit(self, job: FitJob) -> Fitted:
        """Fit and write the components of all wanted textures.

        A fitter that replaces the diffuse colours of a texture writes its ``layers.exr`` into the texture's folder,
        too; the asset takes it from there.
        """


def fit_components(job: FitJob) -> Fitted:
    """Call the fitter of the job's kind.

    Raises
    ------
    ConfigError
        The kind is not registered or cannot be fitted.
    """
    fitter: Fitter = find_kind(job.kind).part("fitting", Fitter)
    return fitter.fit(job)
