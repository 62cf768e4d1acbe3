"""Writes scene folders."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ibrpipe.errors import ConfigError, RendererError, ResourceError
from ibrpipe.io.assets import listed_files, write_asset
from ibrpipe.io.documents.scene import SceneDocument
from ibrpipe.io.own_files import put_in_place, recover
from ibrpipe.io.photos.images import write_exr
from ibrpipe.io.scenes.folder import NAME, matrix_rows, read_document
from ibrpipe.io.scenes.painted import write_painted
from ibrpipe.types import Asset, Instances, LayeredDepthImage, Part, ReliefTexture, Scene, Texture
from ibrpipe.types.renderable import Captured
from ibrpipe.version import VERSION

#: what `write_scene` calls its files and folders; others in scene.yaml were put there by hand
_WRITTEN = re.compile(r"(meshes|matrices|assets|reliefs)/\d{3,}-[^/]+")
#: copies of one part that stand in scene.yaml itself
FEW = 12


def write_scene(scene: Scene, path: str | Path) -> None:
    """Write a scene folder; one that ibrpipe wrote is replaced once the new one is complete, other files in it stay.

    Parameters
    ----------
    scene : Scene
        Nothing is lost: meshes are PLY with float64 places and float32 colours, matrices float64, assets deep OpenEXR.
    path : path
        Folder.

    Raises
    ------
    RendererError
        A part holds a depth image or a relief mesh, which have no form of their own in a scene folder.
    ResourceError
        The folder cannot be written, or holds something that ibrpipe did not write.
    """
    folder = Path(path)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())) and not _is_ours(folder):
        raise ResourceError(f"{folder}: holds files but no scene that ibrpipe wrote; name another folder, or empty it")
    draft = folder.with_name(f".{folder.name}.partial")
    try:
        recover(folder, _own_files)
        shutil.rmtree(draft, ignore_errors=True)
        draft.mkdir(parents=True)
        parts = {
            name: _part(part, draft, f"{n:03d}-{_plain(name)}") for n, (name, part) in enumerate(scene.parts.items())
        }
        lights = [
            {"direction": each.direction.tolist(), "color": each.color.tolist()} for each in scene.lighting.lights
        ]
        content = {
            "version": 1,
            "generator": f"ibrpipe {VERSION}",
            "root": scene.root,
            "lighting": {"ambient": scene.lighting.ambient.tolist(), "lights": lights},
            "parts": parts,
        }
        SceneDocument.model_validate(content)
        text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120, allow_unicode=True)
        (draft / NAME).write_text(text, encoding="utf-8")
        put_in_place(draft, folder, _own_files)
    except OSError as error:
        if isinstance(error, ResourceError):
            raise
        raise ResourceError(f"{folder}: cannot write: {error.strerror or error}") from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _part(part: Part, folder: Path, stem: str) -> dict[str, Any]:
    """Write what a part holds; return its entry."""
    entry: dict[str, Any] = {}
    for n, painted in enumerate(part.meshes):
        file = f"meshes/{stem}-{n}.ply"
        (folder / "meshes").mkdir(exist_ok=True)
        write_painted(painted, folder / file)
        look = {"specular": float(painted.specular), "shininess": float(painted.shininess)} if painted.specular else {}
        entry.setdefault("meshes", []).append({"file": file, **look})
    for n, source in enumerate(part.sources):
        _source(source, entry, folder, f"{stem}-{n}")
    for n, copies in enumerate(part.children):
        entry.setdefault("children", []).append(_copies(copies, folder, f"matrices/{stem}-{n}.npy"))
    return entry


def _source(source: Captured, entry: dict[str, Any], folder: Path, stem: str) -> None:
    if isinstance(source, ReliefTexture):
        place = folder / "reliefs" / stem
        place.mkdir(parents=True)
        np.save(place / "height.npy", source.height)
        write_exr(place / "color.exr", source.color)
        frame = {name: getattr(source.frame, name).tolist() for name in ("origin", "a", "b", "f")}
        entry.setdefault("reliefs", []).append({"folder": f"reliefs/{stem}", "frame": frame})
        return
    if isinstance(source, LayeredDepthImage):
        source = Texture(source)
    if isinstance(source, Texture):
        source = Asset((source,))
    if not isinstance(source, Asset):
        raise RendererError(
            f"a {type(source).__name__} has no form of its own in a scene folder; make an asset of it, or name its "
            "mesh file in scene.yaml (relief_meshes)"
        )
    (folder / "assets").mkdir(exist_ok=True)
    write_asset(source, folder / "assets" / stem)
    entry.setdefault("assets", []).append(f"assets/{stem}")


def _copies(copies: Instances, folder: Path, file: str) -> dict[str, Any]:
    if len(copies) <= FEW:
        return {"part": copies.part, "at": [{"matrix": matrix_rows(matrix)} for matrix in copies.matrices]}
    (folder / "matrices").mkdir(exist_ok=True)
    np.save(folder / file, copies.matrices)
    return {"part": copies.part, "matrices": file}


def _plain(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name)[:80]


def _is_ours(folder: Path) -> bool:
    try:
        return read_document(folder / NAME)[0].generator is not None
    except (ConfigError, OSError):
        return False


def _own_files(folder: Path) -> set[str]:
    """Return the files of a scene that `write_scene` wrote; none of one made by hand."""
    if not _is_ours(folder):
        return set()
    found = {NAME}
    for part in read_document(folder / NAME)[0].parts.values():
        found |= _written(mesh.file for mesh in part.meshes)
        found |= _written(copies.matrices for copies in part.children if copies.matrices is not None)
        found |= {f"{asset}/{file}" for asset in _written(part.assets) for file in listed_files(folder / asset)}
        reliefs = _written(relief.folder for relief in part.reliefs)
        found |= {f"{relief}/{file}" for relief in reliefs for file in ("height.npy", "color.exr")}
    return found


def _written(names: Iterable[str]) -> set[str]:
    return {name for name in names if _WRITTEN.fullmatch(name)}
