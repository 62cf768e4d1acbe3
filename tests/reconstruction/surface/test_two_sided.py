"""A thin wall painted red outside and blue inside keeps both colours; what has no second side stays as it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ibrpipe
from ibrpipe.embree import MeshCaster
from ibrpipe.evaluation.report.surface_words import surface_sentences
from ibrpipe.io.documents.geometry import Geometry
from ibrpipe.io.layers import read_layers
from ibrpipe.io.surfaces.meshes import read_mesh, write_mesh
from ibrpipe.io.views import load_view, read_views
from ibrpipe.modelling.frusta import Frustum
from ibrpipe.reconstruction.depth.evidence import evidence
from ibrpipe.reconstruction.depth.map_store import LoadedMap
from ibrpipe.reconstruction.surface.mesh_operations import openings
from ibrpipe.reconstruction.surface.two_sided import (
    Backs,
    backs_seen,
    doubled,
    smoothed,
    whole_patches,
    with_second_side,
)
from ibrpipe.stages import ingest, layers, plan
from ibrpipe.synthetic.capture import SynthConfig, write_capture
from ibrpipe.synthetic.light import Studio
from ibrpipe.synthetic.paints import grain
from ibrpipe.synthetic.scene import Part, Rig, Scene
from ibrpipe.synthetic.surfaces import sheet
from ibrpipe.types import Array, Mesh, SpiralTexture

#: radius of the wall's outside, its thickness (about a voxel of the photos below), half its angle
RADIUS, THICK, HALF = 1.0, 0.03, 1.2


def arc(radius: float, turn: float):
    """Half a tube standing upright; turn -1 = seen from inside."""

    def surface(u: Array, v: Array) -> Array:
        return np.stack([radius * np.cos(HALF * turn * u), radius * np.sin(HALF * turn * u), 0.6 * v], axis=-1)

    return surface


def painted(color: tuple[float, float, float]):
    return lambda points: np.array(color) * (1 + 0.3 * grain(points, 14.0))[:, None]


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Mesh, Mesh]:
    """Ingested views of the thin wall, its outside alone, and both of its sides."""
    outside = Part("outside", sheet(arc(RADIUS, 1), 40, 20), painted((0.5, 0.1, 0.1)))
    inside = Part("inside", sheet(arc(RADIUS - THICK, -1), 40, 20), painted((0.1, 0.1, 0.5)))
    even = Studio(zenith=(0.9, 0.9, 0.9), horizon=(0.9, 0.9, 0.9), ground=(0.9, 0.9, 0.9))
    scene = Scene("wall", "a thin wall", (outside, inside), even, Rig(elevations_deg=(-5.0, 45.0), rings=3))
    config = SynthConfig(photos=24, tests=0, width=120, height=96, rays=2, occlusion_rays=0, mesh=False)
    folder = tmp_path_factory.mktemp("wall")
    capture = write_capture(scene, folder / "capture", config)
    done = ingest.run(ingest.Inputs(capture, folder / "ingest"), ingest.IngestConfig())
    return done.views, outside.shape.mesh, read_mesh(capture / "truth/mesh.ply")


def test_both_colours_of_a_thin_wall_come_through_to_its_layers(wall, tmp_path: Path) -> None:
    place, outside, both = wall
    views, caster, maps = read_views(place).train, MeshCaster(both), Maps()
    for view in views:
        hits = caster.cast_camera(view.camera)
        depth = np.where(np.isfinite(hits.t), hits.t, 0).astype(np.float32)
        maps.append(LoadedMap(view.name, view.camera, depth, hits.normal, np.ones_like(depth), load_view(view)[1]))
    surface = with_second_side(outside, maps, THICK, 4.0, "auto")
    np.testing.assert_array_equal(surface.mesh.vertices[: len(outside.vertices)], outside.vertices)
    np.testing.assert_array_equal(surface.mesh.faces[: len(outside.faces)], outside.faces)
    assert surface.share == pytest.approx(1.0)
    assert 0.8 * THICK < surface.thickness < 1.1 * THICK
    found = evidence(surface.mesh, maps, 2 * THICK, surface.facing)
    alone = evidence(surface.mesh, maps, 2 * THICK)
    sides = found.observations[: len(outside.vertices)], found.observations[len(outside.vertices) :]
    assert min(np.median(side) for side in sides) >= 3
    assert (alone.observations >= found.observations).all()
    assert np.median(alone.observations) > 1.4 * np.median(found.observations)  # maps of both sides together
    shown = colours(place, surface.mesh, tmp_path / "two")
    assert shown["red"] > 0.9
    assert shown["blue"] > 0.9
    assert colours(place, outside, tmp_path / "one")["blue"] == 0  # what it was before


def colours(place: Path, mesh: Mesh, out: Path) -> dict[str, float]:
    """Build layers on a mesh and say how much of the photos' red and blue pixels is shown so."""
    out.mkdir()
    write_mesh(mesh, out / "mesh.ply")
    planned = plan.run(
        plan.Inputs(place, out / "mesh.ply", 0, out), plan.PlanConfig(residuals="never", samples=2000, texel=0.025)
    )
    built = layers.run(layers.Inputs(place, out / "mesh.ply", planned.plan, out), layers.LayersConfig(sharpen=0))
    textures = [
        SpiralTexture(read_layers(each / "layers.exr"), None) for each in sorted(built.layers.glob("texture_*"))
    ]
    right, total = dict.fromkeys(("red", "blue"), 0), dict.fromkeys(("red", "blue"), 0)
    for view in read_views(place).train[::3]:
        photo, mask = load_view(view)
        shown = ibrpipe.render(textures, view.camera, renderer="ldi").color
        for name, own, other in (("red", 0, 2), ("blue", 2, 0)):
            wanted = (mask > 0.99) & (photo[..., own] > 2 * photo[..., other])
            found = (shown[..., own] > 2 * shown[..., other]) & (np.abs(shown - photo).max(axis=2) < 0.1)
            right[name], total[name] = right[name] + int((found & wanted).sum()), total[name] + int(wanted.sum())
    assert min(total.values()) > 1000
    return {name: right[name] / total[name] for name in total}


class Maps(list):
    """Loaded maps where a store of them is asked for."""


def looking(mesh: Mesh, eyes: list[tuple[float, float, float]], shift: float = 0.0) -> Maps:
    """Depth maps of a mesh about the origin from `eyes`, `shift` nearer than it is."""
    maps = Maps()
    for number, eye in enumerate(eyes):
        camera = Frustum(eye=eye, target=(0, 0, 0), up=(0, 0, 1), fov=45.0).camera(64)
        hits = MeshCaster(mesh).cast_camera(camera)
        depth = np.where(np.isfinite(hits.t), hits.t - shift, 0).astype(np.float32)
        ones = np.ones_like(depth)
        maps.append(LoadedMap(str(number), camera, depth, hits.normal, ones, ones))
    return maps


AROUND = [(4.0, 0.5, 0.5), (3.0, 2.0, 0.2), (-4.0, 0.5, 0.5), (-3.0, -2.0, 0.2), (0.3, 4.0, 1.0), (0.3, -4.0, 1.0)]


def test_closed_and_one_sided_surfaces_stay_the_bytes_that_they_were(measured) -> None:
    ball = measured("ball").caster.mesh
    assert backs_seen(ball, looking(ball, AROUND), 0.02, 4.0).share == 0
    assert "closed" in with_second_side(ball, Maps(), 0.02, 4.0, "auto").reason
    plate = sheet(lambda u, v: np.stack([0 * u, u, v], axis=-1), 20, 20).mesh
    for mesh, eyes in ((ball, AROUND), (plate, AROUND[:2])):
        surface = with_second_side(mesh, looking(mesh, eyes), 0.02, 4.0, "auto")
        assert surface.mesh is mesh
        assert (surface.share, surface.backs) == (0, 0)
        np.testing.assert_array_equal(surface.source, np.arange(len(mesh.vertices)))


@pytest.mark.parametrize(("shift", "share"), [(0.03, 1.0), (0.3, 0.0)])
def test_a_back_counts_where_depth_is_in_place(shift: float, share: float) -> None:
    plate = sheet(lambda u, v: np.stack([0 * u, u, v], axis=-1), 20, 20).mesh  # faces +x
    surface = with_second_side(
        plate, looking(plate, AROUND[:2]) + looking(plate, AROUND[2:4], shift), 0.02, 4.0, "auto"
    )
    assert surface.share == pytest.approx(share)
    if share:
        assert surface.thickness == pytest.approx(0.03 * 4 / np.linalg.norm(AROUND[2]), rel=0.2)
        apart = np.linalg.norm(surface.mesh.vertices - plate.vertices[surface.source], axis=1)
        assert apart.max() < 2 * surface.thickness
        assert openings(surface.mesh).loops == 0  # joined along the border
        assert openings(surface.mesh).crowded == 0
        volume = np.linalg.det(surface.mesh.vertices[surface.mesh.faces]).sum() / 6
        assert volume == pytest.approx(4 * surface.thickness, rel=0.1)  # faces outward on both sides


@pytest.mark.parametrize(("shift", "least", "most"), [(0.3, 0.95, 1.0), (-0.3, 0.0, 0.0)])
def test_what_stands_before_a_back_does_not_contradict_it_and_looking_through_does(shift, least, most) -> None:
    plate = sheet(lambda u, v: np.stack([0 * u, u, v], axis=-1), 20, 20).mesh
    maps = looking(plate, AROUND[2:3], 0.03) + looking(plate, AROUND[3:4], shift)
    assert least <= with_second_side(plate, maps, 0.02, 4.0, "auto").share <= most


def test_likely_backs_count_only_beside_sure_ones_and_gaps_close() -> None:
    plate = sheet(lambda u, v: np.stack([0 * u, u, v], axis=-1), 30, 30).mesh
    y, none = plate.vertices[:, 1], np.zeros(len(plate.vertices))
    hole = np.abs(plate.vertices[:, 1:] - (-0.5, 0.1)).max(axis=1) < 0.09
    sure, likely = (y < -0.2) & ~hole, y < 0.5
    marked = whole_patches(plate, Backs(sure, likely, none, none, 0.1))
    np.testing.assert_array_equal(marked, y < 0.5)
    assert not whole_patches(plate, Backs(y < -5, likely, none, none, 0.1)).any()


def test_thickness_is_smooth_and_extended() -> None:
    plate = sheet(lambda u, v: np.stack([0 * u, u, v], axis=-1), 30, 30).mesh
    known = np.where(plate.vertices[:, 1] < 0, 20.0, 0.0)
    noise = np.random.default_rng(0).normal(0, 0.2, len(known))
    backs = Backs(known > 0, known > 0, known * (1 + noise), known, 0.1)
    thick = smoothed(plate, backs)
    assert np.abs(thick - 1).max() < 0.2
    assert 0.02 < np.std(thick[known > 0]) < 0.12
    surface = doubled(plate, np.ones(len(known), bool), backs, 5.0, "")
    assert surface.thickness == 5.0  # the least distance


def test_backs_are_counted_in_place(measured) -> None:
    plate = sheet(lambda u, v: np.stack([0 * u, u, v], axis=-1), 20, 20).mesh
    backs = backs_seen(plate, looking(plate, AROUND[:4]), 0.02, 4.0)
    assert backs.seen.mean() > 0.99
    assert backs.share == pytest.approx(0.5, abs=0.02)


def test_the_report_tells_of_a_second_side() -> None:
    facts = {"schema": 1, "decision": "photos", "reason": "depth agrees", "vertices": 3, "faces": 1}
    one = Geometry.model_validate({**facts, "two_sided": {"share": 0.613, "thickness": 0.00512}})
    told = " ".join(surface_sentences(None, one))
    assert "61 % of it is a thin wall that photos see from both sides, and has a second side 0.00512 scene" in told
    none = Geometry.model_validate({**facts, "two_sided": {"share": 0.0}})
    assert "second side" not in " ".join(surface_sentences(None, none))
