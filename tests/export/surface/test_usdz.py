"""USDZ as USD's own library reads it, and as an archive."""

from __future__ import annotations

import struct
from zipfile import ZipFile

import numpy as np
import pytest
from page_assets import make_asset

import ibrpipe
from ibrpipe.export.usdz import ALIGNMENT, packed


def test_files_are_not_compressed_and_begin_at_multiples_of_the_alignment(tmp_path):
    content = packed({"scene.usda": b"#usda 1.0\n", "color.png": b"x" * 100, "third": b"y"})
    (tmp_path / "a.usdz").write_bytes(content)
    with ZipFile(tmp_path / "a.usdz") as archive:
        assert archive.testzip() is None
        assert archive.namelist()[0] == "scene.usda"  # the first file is what is shown
        for entry in archive.infolist():
            name, extra = struct.unpack_from("<HH", content, entry.header_offset + 26)
            begin = entry.header_offset + 30 + name + extra
            assert begin % ALIGNMENT == 0
            assert content[begin : begin + entry.file_size] == archive.read(entry)


def test_usd_reads_the_mesh_that_the_obj_holds(tmp_path):
    usd = pytest.importorskip("pxr.Usd", reason="needs usd-core")
    from pxr import UsdGeom, UsdShade

    told = ibrpipe.export(make_asset("matt"), tmp_path / "a.usdz", tolerance=1)
    assert "triangles" in told
    ibrpipe.export(make_asset("matt"), tmp_path / "a.obj", tolerance=1)
    lines = (tmp_path / "a.obj").read_text().splitlines()
    places, texels = (
        np.array([line.split()[1:] for line in lines if line.startswith(f"{key} ")], float) for key in ("v", "vt")
    )
    stage = usd.Stage.Open(str(tmp_path / "a.usdz"))
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Object/Surface"))
    assert UsdGeom.Mesh.ValidateTopology(
        mesh.GetFaceVertexIndicesAttr().Get(), mesh.GetFaceVertexCountsAttr().Get(), len(mesh.GetPointsAttr().Get())
    )[0]
    np.testing.assert_allclose(mesh.GetPointsAttr().Get(), places, atol=1e-6)
    st = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
    np.testing.assert_allclose(st.Get(), texels, atol=2e-6)
    corners = [[int(corner.split("/")[0]) - 1 for corner in line.split()[1:]] for line in lines if line[:2] == "f "]
    assert np.array_equal(mesh.GetFaceVertexIndicesAttr().Get(), np.ravel(corners))
    np.testing.assert_allclose(np.linalg.norm(mesh.GetNormalsAttr().Get(), axis=1), 1, atol=1e-4)
    surface = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()[0].ComputeSurfaceSource()[0]
    assert surface.GetIdAttr().Get() == "UsdPreviewSurface"
    picture = surface.GetInput("emissiveColor").GetConnectedSources()[0][0].source
    assert picture.GetPrim().GetAttribute("inputs:file").Get().resolvedPath  # found inside the archive


def test_usds_own_validators_find_nothing(tmp_path):
    usd = pytest.importorskip("pxr.Usd", reason="needs usd-core")
    validation = pytest.importorskip("pxr.UsdValidation", reason="needs usd-core 25.2 or later")
    ibrpipe.export(make_asset("matt"), tmp_path / "a.usdz", tolerance=8)
    all_of_them = validation.ValidationRegistry().GetOrLoadAllValidators()
    assert any("UsdzPackage" in each.GetMetadata().name for each in all_of_them)
    stage = usd.Stage.Open(str(tmp_path / "a.usdz"))
    found = validation.ValidationContext(all_of_them).Validate(stage)
    assert [each.GetMessage() for each in found] == []


def test_the_same_asset_gives_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        ibrpipe.export(make_asset("perspective"), tmp_path / f"{name}.usdz", tolerance=8)
    assert (tmp_path / "a.usdz").read_bytes() == (tmp_path / "b.usdz").read_bytes()
