"""The fitter of the kind "spiral": residuals of all textures, sampled, refined together, coded and written."""

from __future__ import annotations

from ibrpipe.errors import ConfigError
from ibrpipe.io.assets import write_component
from ibrpipe.modelling.view_dependence.coding import code
from ibrpipe.modelling.view_dependence.fitter import FitJob, Fitted
from ibrpipe.modelling.view_dependence.residuals_file import ResidualsFigures
from ibrpipe.modelling.view_dependence.sample_sets import Samples, assemble
from ibrpipe.modelling.view_dependence.spiral import ResidualsConfig, refine, sample
from ibrpipe.modelling.view_dependence.work_units import forget

ERRORS = "errors.partial.npy"


class SpiralFitter:
    """Residuals on spiral directions (gong-yang, sec. 4.2)."""

    def fit(self, job: FitJob) -> Fitted:
        """Sample residuals for every texture that the plan wants them for, and refine them all together.

        Raises
        ------
        CaptureError, FormatError
            The views, the mesh, the plan or the layers cannot be read.
        """
        config = job.config
        if not isinstance(config, ResidualsConfig):
            raise ConfigError(f"the spiral takes ResidualsConfig, got {type(config).__name__}")
        try:
            samples = [sample(job.sources, which, config, job.out) for which in job.wanted]
            psnr = refine(job.sources, samples, job.out / ERRORS, config) if samples else []
        finally:
            forget()
        figures = tuple(write_texture(job, each, config) for each in samples)
        samples.clear()  # some systems do not remove files that are mapped
        for leftover in job.out.glob("*.partial"):
            leftover.unlink()
        return Fitted(figures, training_psnr=tuple(round(value, 3) for value in psnr))


def write_texture(job: FitJob, samples: Samples, config: ResidualsConfig) -> ResidualsFigures:
    """Code and write one texture's residuals; return their figures."""
    plan, folder = job.plans[samples.which], job.folder(samples.which)
    texels, valid, zero, clamped = code(samples, config)
    residuals = assemble(plan, config.closed, texels, valid, zero)
    component = write_component(residuals, folder, config.quality).below(folder.name)
    return ResidualsFigures(
        name=plan.rectangle.name,
        directions=len(residuals.alphas),
        texels=len(valid),
        valid_share=float(valid.mean()),
        clamped_texels=clamped,
        clamped_share=float(clamped / max(valid.sum(), 1)),
        zero=zero,
        encoding=config.encoding,
        texture=samples.which,
        bytes=sum((job.out / path).stat().st_size for path in component.paths),
        component=component,
    )
