"""pipelines/mesh.yaml says that its values are the defaults: they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from ibrpipe.engine.pipeline_file import load_pipeline
from ibrpipe.stages.registry import load_stage, load_stages, registered

MESH = load_pipeline(Path("mesh"), load_stages())


@pytest.mark.parametrize("stage", list(registered()))
def test_the_values_of_the_mesh_pipeline_are_the_defaults(stage: str) -> None:
    assert MESH.configs[stage] == load_stage(stage).config()
