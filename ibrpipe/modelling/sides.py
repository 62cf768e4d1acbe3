"""Which sides of a surface photos see: sheets get both, closed bodies one, and neither hangs on how faces are wound.

A mesh falls into patches that can be wound one way (:mod:`ibrpipe.core.surface_patches`). For each, photos tell how
many pixels inside their masks show either side of it. A patch that is closed, or that hardly any pixel shows from one
side, has the side that is seen most; any other has two, and each side is a surface of its own from then on.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ibrpipe.capture.photo_set import PhotoSet
from ibrpipe.core.normals import face_normals
from ibrpipe.core.surface_patches import patches
from ibrpipe.embree import MeshCaster
from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.untrusted.arrays import load_npz
from ibrpipe.modelling.plan_file import Told, reason
from ibrpipe.types import Array, Mesh

#: rays that ask a photo what it sees, about
RAYS = 40_000
#: share of a patch's pixels, and pixels at all, that must show its less seen side
LEAST_SHARE, LEAST_PIXELS = 0.02, 12
#: least cosine between ray and face for a pixel to count
GRAZING = 0.05

TwoSided = Literal["auto", "never", "always"]


@dataclass(frozen=True, eq=False)
class Sides:
    """Sides of the F faces of a mesh.

    Attributes
    ----------
    turned : (F,) bool, wound so that photos see the back; is to be turned
    both : (F,) bool, has two sides
    again : (F,) bool, repeats another face, wound either way; is left out
    """

    turned: Array
    both: Array
    again: Array

    def caster(self, mesh: Mesh) -> MeshCaster:
        """Prepare a mesh with these sides for rays.

        Raises
        ------
        FormatError
            The mesh has another number of faces.
        """
        if len(mesh.faces) != len(self.turned):
            raise FormatError(
                f"the plan tells the sides of {len(self.turned)} faces but the mesh has {len(mesh.faces)}; run the "
                "plan stage again"
            )
        faces = np.where(self.turned[:, None], mesh.faces[:, ::-1], mesh.faces)[~self.again]
        return MeshCaster(Mesh(mesh.vertices, faces), two_sided=self.both[~self.again] if self.both.any() else None)

    @property
    def plain(self) -> bool:
        """Every face has one side, as it is wound."""
        return not (self.turned.any() or self.both.any() or self.again.any())


def find_sides(mesh: Mesh, photos: PhotoSet, choice: TwoSided = "auto") -> tuple[Sides, Told]:
    """Ask the photos which sides of every patch they see.

    Parameters
    ----------
    mesh : Mesh
    photos : PhotoSet
        Their masks and cameras count, not their depth.
    choice : "auto", "never" or "always"
        always gives every patch that is not closed two sides, never gives none.
    """
    patch, against, closed = patches(mesh.vertices, mesh.faces)
    fronts, backs = seen_sides(MeshCaster(mesh), photos)
    own = patch >= 0
    count = len(closed)
    ahead, behind = (np.bincount(patch[own], each[own], count) for each in (
        np.where(against, backs, fronts), np.where(against, fronts, backs)))  # fmt: skip
    less, shown = np.minimum(ahead, behind), ahead + behind
    two = ~closed & (less >= np.maximum(LEAST_PIXELS, LEAST_SHARE * shown))
    if choice != "auto":
        two = ~closed if choice == "always" else np.zeros(count, bool)
    unseen = shown == 0
    turned = np.zeros(len(mesh.faces), bool)
    turned[own] = np.where(unseen[patch[own]], False, against[own] != (behind > ahead)[patch[own]])
    sides = Sides(turned, own & two[np.maximum(patch, 0)], ~own)
    return sides, _told(mesh, sides, patch, two, (ahead, behind), closed, choice)


def seen_sides(caster: MeshCaster, photos: PhotoSet) -> tuple[Array, Array]:
    """Pixels of all photos, inside their masks, that show the front and the back of every face: (F,) int64 each."""
    fronts, backs = (np.zeros(len(caster.mesh.faces), np.int64) for _ in range(2))
    for p, camera in enumerate(photos.cameras):
        step = max(1, int(np.sqrt(camera.width * camera.height / RAYS)))
        row, column = np.meshgrid(
            np.arange(p % step, camera.height, step), np.arange(step // 2, camera.width, step), indexing="ij"
        )
        shown = photos.mask[photos.starts[p] + row * camera.width + column] >= 0.5
        rays = camera.pixel_rays(np.stack([column[shown], row[shown]], axis=1) + 0.5)
        hits = caster.cast(camera.center, rays)
        slope = (hits.normal * rays).sum(axis=1) / np.linalg.norm(rays, axis=1)
        met = hits.face >= 0
        fronts += np.bincount(hits.face[met & (slope < -GRAZING)], minlength=len(fronts))
        backs += np.bincount(hits.face[met & (slope > GRAZING)], minlength=len(backs))
    return fronts, backs


def _told(
    mesh: Mesh, sides: Sides, patch: Array, two: Array, pixels: tuple[Array, Array], closed: Array, choice: TwoSided
) -> Told:
    """Say what was decided, with the figures behind it."""
    area = np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1)
    whole = max(float(area[~sides.again].sum()), 1e-300)
    shares = {name: round(float(area[faces].sum()) / whole, 4) for name, faces in (
        ("both_sides_share", sides.both), ("turned_share", sides.turned & ~sides.both))}  # fmt: skip
    less, shown = np.minimum(*pixels), pixels[0] + pixels[1]
    single, double = (float(less[each].sum() / max(shown[each].sum(), 1)) for each in (~two, two))
    figures = {
        "pieces": len(two), "closed_pieces": int(closed.sum()), "pieces_with_both_sides": int(two.sum()), **shares,
        "faces_left_out": int(sides.again.sum()), "less_seen_side_of_those": round(double, 4),
        "less_seen_side_of_others": round(single, 4),
    }  # fmt: skip
    part = f"{two.sum()} of {len(two)} pieces"
    seen = f"photos see {part} from both sides, {100 * shares['both_sides_share']:.0f} % of the area"
    if choice != "auto":
        seen = f"set by plan.two_sided: {part} get both sides"
    elif not two.any():
        seen = f"photos see none of {len(two)} pieces from both sides"
    turned = shares["turned_share"]
    seen += f"; {100 * turned:.0f} % of the area is wound against what they see and was turned" if turned > 0 else ""
    return reason("sides of the surface", "both" if two.any() else "one", seen, **figures)


def write_sides(sides: Sides, path: Path) -> None:
    """Write sides as a NumPy archive, a bit a face."""
    bits = np.packbits(np.stack([sides.turned, sides.both, sides.again]), axis=1)
    np.savez_compressed(path, sides=bits, faces=np.int64(len(sides.turned)))


def read_sides(path: Path) -> Sides:
    """Read what `write_sides` wrote.

    Raises
    ------
    MissingFileError, FormatError
        The file is missing or damaged.
    """
    try:
        archive = load_npz(path, "run the plan stage again", "not the sides of a mesh")
        bits, faces = archive["sides"], int(archive["faces"])
        return Sides(*np.unpackbits(bits, axis=1, count=faces).astype(bool))
    except MissingFileError as error:
        raise MissingFileError(f"{path}: no such file; run the plan stage again") from error
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(f"{path}: not the sides of a mesh ({error}); run the plan stage again") from error


def caster_of(mesh: Mesh, sides: Path | None) -> MeshCaster:
    """Prepare a mesh for rays, with the sides in a file of the plan stage if there is one."""
    return MeshCaster(mesh) if sides is None else read_sides(sides).caster(mesh)
