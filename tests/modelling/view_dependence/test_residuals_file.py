"""``residuals.json``: files of earlier versions, components of several kinds, damaged ones."""

from __future__ import annotations

import json

import pytest

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.components import Component
from ibrpipe.modelling.view_dependence.residuals_file import (
    ComponentFigures,
    Residuals,
    ResidualsFigures,
    measured,
    read_document,
)

EARLIER = {
    **{"name": "+x", "directions": 60, "texels": 900, "valid_share": 0.5, "clamped_texels": 3, "clamped_share": 0.01},
    **{"zero": 32, "encoding": "8bit", "texture": 3, "bytes": 1234},
}


def write(folder, *textures, **more):
    (folder / "residuals.json").write_text(json.dumps({"textures": textures, **more}))


def test_a_file_of_an_earlier_version_names_its_archives(tmp_path):
    write(tmp_path, EARLIER, training_psnr=[30.0, 31.5])
    document = read_document(tmp_path)
    (figures,) = document.of_texture(3)
    assert figures.component == Component(kind="spiral", file="texture_03/residuals.zip")
    assert list(measured(figures).items()) == list(EARLIER.items())
    assert (document.training_psnr, document.shared, document.of_texture(0)) == ([30.0, 31.5], [], [])


def test_kinds_side_by_side(tmp_path):
    tint = ComponentFigures(
        name="+x",
        texture=3,
        bytes=9,
        component=Component(kind="tint", files=("texture_03/a", "texture_03/b")),
        gain=0.5,
    )
    document = Residuals(textures=[ResidualsFigures(**EARLIER), tint], shared=[Component(kind="tint", file="book")])
    (tmp_path / "residuals.json").write_text(json.dumps(document.model_dump()))
    back = read_document(tmp_path)
    assert back == document
    assert [type(figures) for figures in back.of_texture(3)] == [ResidualsFigures, ComponentFigures]
    assert measured(back.of_texture(3)[1]) == {"name": "+x", "texture": 3, "bytes": 9, "gain": 0.5}


def test_what_is_damaged_or_missing_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"residuals\.json: does not exist; run the residuals stage first"):
        read_document(tmp_path)
    write(tmp_path, {"name": "+x"})
    with pytest.raises(FormatError, match=r"residuals\.json: damaged \(textures\.0\..*run the residuals stage again"):
        read_document(tmp_path)
