"""`ibrpipe.run`: chooses the pipeline, runs it, and tells how far it came."""

from __future__ import annotations

from pathlib import Path

import pytest

import ibrpipe


def test_the_pipeline_is_chosen_and_settings_may_be_nested(tiny_ball: Path, tmp_path: Path) -> None:
    lines: list[str] = []
    settings = {"ingest": {"hold_out_every": 5}, "ingest.exposure": "none"}
    done = ibrpipe.run(tiny_ball, tmp_path / "out", settings=settings, last="ingest", progress=lines.append)
    assert done.pipeline == "mesh"
    assert list(done.seconds) == ["calibrate", "ingest"]
    assert lines[0] == f"{tiny_ball}: cameras and mesh.ply: pipeline mesh"
    assert [line.split(":")[0] for line in lines if "starts" in line] == ["calibrate", "ingest"]
    told = (tmp_path / "out/ingest/manifest.json").read_text()
    assert '"hold_out_every": 5' in told
    assert '"exposure": "none"' in told
    assert repr(done) == f"FinishedRun('{tmp_path / 'out'}', pipeline mesh, 2 stages)"
    with pytest.raises(ibrpipe.IbrError, match="the run has not come to stage compress; run it to there"):
        _ = done.asset
    with pytest.raises(ibrpipe.IbrError, match="the run has not come to stage evaluate"):
        _ = done.report


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"ingst.exposure": "csv"}, 'did you mean "ingest"'),
        ({"ingest": {"hold_out_every": -1}}, "greater than or equal to 0"),
    ],
)
def test_wrong_settings_are_told_before_anything_is_written(
    tiny_ball: Path, tmp_path: Path, settings: dict, message: str
) -> None:
    with pytest.raises(ibrpipe.IbrError, match=message):
        ibrpipe.run(tiny_ball, tmp_path / "out", "mesh", settings)
    assert not (tmp_path / "out").exists()


def test_something_must_be_given(tmp_path: Path) -> None:
    with pytest.raises(ibrpipe.IbrError, match="neither a capture nor a pipeline is given"):
        ibrpipe.run(out=tmp_path)
