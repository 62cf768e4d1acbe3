"""Code an asset in several ways into one folder, and measure what comes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from ibrpipe.io.assets import INDEX, files_of, read_asset, read_index
from ibrpipe.io.layer_pictures.avif import QUICK, THOROUGH
from ibrpipe.io.manifest import files_below
from ibrpipe.io.recoding import finish, recode
from ibrpipe.modelling.compression.document import Trial
from ibrpipe.modelling.compression.parts import Measure, Source
from ibrpipe.modelling.compression.steps import CodingStep


@dataclass
class Coder:
    """Codes the asset `source` into the folder `out`."""

    source: Source
    measure: Measure
    out: Path
    trials: list[Trial] = field(default_factory=list)

    def write(self, step: CodingStep, speed: int = QUICK) -> None:
        """Write the asset into `out`, where no other one remains."""
        if (self.out / INDEX).is_file():
            for name in files_of(read_index(self.out)):
                (self.out / name).unlink(missing_ok=True)
        index = recode(
            self.source.folder, self.source.index, self.source.asset, self.out, step.layers, step.quality_of, speed
        )
        finish(index, self.out, [{}] * len(index.textures))

    def tried(self, step: CodingStep) -> Trial:
        """Code the asset and measure it, or tell what that gave before."""
        for trial in self.trials:
            if CodingStep(trial.layers, trial.component_quality, trial.weight_quality) == step:
                return trial
        self.write(step)
        self.trials.append(self._measured(step))
        return self.trials[-1]

    def settle(self, step: CodingStep, kept: Callable[[Trial], bool]) -> Trial:
        """Leave the asset coded in this step, thoroughly unless that breaks a promise that quick coding keeps."""
        self.write(step, THOROUGH)
        thorough = self._measured(step)
        if kept(thorough) or not kept(self.tried(step)):
            return thorough
        self.write(step)
        return self.tried(step)

    def _measured(self, step: CodingStep) -> Trial:
        psnr = self.measure(read_asset(self.out))
        return Trial(
            layers=step.layers,
            component_quality=step.components,
            weight_quality=step.weights,
            bytes=size_of(self.out),
            psnr=None if psnr is None else round(psnr, 4),
        )


def size_of(folder: Path) -> int:
    """Return the bytes of an asset folder."""
    return sum(path.stat().st_size for path in files_below(folder))
