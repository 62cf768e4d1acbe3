"""What is in a folder or file of ibrpipe, as plain facts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ibrpipe.config import Document
from ibrpipe.engine.artifacts import products
from ibrpipe.engine.run_document import RunDocument
from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.manifest import RUN_NAME, Manifest, files_below, read_manifest
from ibrpipe.stages.registry import load_stages

if TYPE_CHECKING:
    from ibrpipe.io.assets import TextureEntry
    from ibrpipe.types import Part, Scene

Facts = dict[str, Any]


def describe(path: Path) -> Facts:
    """Return the facts about a capture, run, asset or scene folder, a ``views.json``, a glTF file or a video.

    ``kind`` says which.

    Raises
    ------
    MissingFileError
        There is nothing at `path`.
    IbrError
        What is there cannot be read.
    """
    from ibrpipe.io.scenes import is_scene, read_scene
    from ibrpipe.io.surfaces.reliefs import is_reliefs
    from ibrpipe.io.videos.read import is_video

    if not path.exists():
        raise MissingFileError(f"{path} does not exist; expected a capture, run, asset or scene, or a views.json")
    if is_scene(path):
        return scene_facts(read_scene(path), path)
    if path.is_file() and is_video(path):
        return _video(path)
    if path.is_file():
        if path.suffix.lower() != ".json":
            raise FormatError(f"{path}: is neither a views.json nor a scene; give the folder that holds it")
        return _views(path)
    if is_reliefs(path):
        return _reliefs(path)
    if (path / "asset.json").is_file():
        return _asset(path)
    if (path / RUN_NAME).is_file():
        return _run(path)
    if (path / "views.json").is_file():
        return _views(path / "views.json")
    own = read_manifest(path)
    if own is not None and own.stage != "synth":
        return {"kind": "stage", "path": str(path), "stage": own.stage, **_cost(own)}
    if any(read_manifest(path / stage.folder) for stage in load_stages()):
        return _run(path)
    return _capture(path)


def bytes_below(folder: Path) -> int:
    """Return the sizes of the files below `folder`, manifests left out, in bytes."""
    return sum(path.stat().st_size for path in files_below(folder))


def scene_facts(scene: Scene, path: Path) -> Facts:
    """Return what a scene consists of; nothing is taken apart."""
    uses = scene.uses
    facts: Facts = {"kind": "scene", "path": str(path)}
    facts |= {"bytes": bytes_below(path) if path.is_dir() else path.stat().st_size, "root": scene.root}
    facts |= {"sub_objects": scene.sub_objects[scene.root], "polygons": scene.polygons[scene.root]}
    bounds = scene.bounds[scene.root]
    if not bounds.empty:
        facts |= {"low": bounds.low.tolist(), "high": bounds.high.tolist()}
    facts["lights"] = len(scene.lighting.lights)
    facts["parts"] = {name: _part(scene, part, uses[name]) for name, part in scene.parts.items()}
    return facts


def _part(scene: Scene, part: Part, uses: int) -> Facts:
    from ibrpipe.io.scenes.placement import singular

    facts: Facts = {"instances": uses, "own_polygons": sum(len(each.mesh.faces) for each in part.meshes)}
    facts |= {"polygons": scene.polygons[part.name], "sub_objects": scene.sub_objects[part.name]}
    facts["copies_held"] = sum(len(copies) for copies in part.children)
    flat = sum(int(singular(copies.matrices).sum()) for copies in part.children)
    arrays = [array for each in part.meshes for array in (each.mesh.vertices, each.mesh.faces, each.color)]
    facts["bytes"] = sum(array.nbytes for array in arrays) + sum(copies.matrices.nbytes for copies in part.children)
    facts |= {"sources": len(part.sources)} if part.sources else {}
    return facts | ({"flattened_copies": flat} if flat else {})


def _capture(path: Path) -> Facts:
    from ibrpipe.io.cameras.sources import has_cameras
    from ibrpipe.io.captures import read_capture
    from ibrpipe.io.surfaces.meshes import read_mesh

    if not has_cameras(path):
        return _photos(path)
    capture = read_capture(path)
    facts: Facts = {"kind": "capture", "path": str(path)}
    facts |= {"photos": len(capture.train), "held_out": len(capture.test), "sizes": _sizes(capture.train)}
    facts |= {"masks": sum(1 for view in capture.train if view.mask or view.mask_from_alpha)}
    facts |= {"photo_bytes": sum(view.image.stat().st_size for view in (*capture.train, *capture.test))}
    facts |= {"exposure": capture.exposure, "true_depth": sum(1 for view in capture.test if view.depth)}
    facts["mesh"] = None
    if capture.mesh is not None:
        mesh = read_mesh(capture.mesh)
        facts["mesh"] = {"file": capture.mesh.name, "vertices": len(mesh.vertices), "faces": len(mesh.faces)}
    return facts | {"notes": list(capture.notes), "warnings": list(capture.warnings)}


def _photos(path: Path) -> Facts:
    """Return the facts about a capture folder without cameras."""
    from ibrpipe.calibration.photos import photo_files, photos_of
    from ibrpipe.io.cameras.shots import photo_root
    from ibrpipe.io.photos.exif import read_exif
    from ibrpipe.io.photos.extra_formats import RAW_SUFFIXES
    from ibrpipe.io.photos.image_files import read_header
    from ibrpipe.stages.stills import videos_of

    videos = videos_of(path)
    photos = () if videos and not photo_files(photo_root(path)) else photos_of(path)
    headers = [read_header(Path(photo.image)) for photo in photos]
    focals = [read_exif(Path(photo.image)).focal for photo in photos]
    facts: Facts = {"kind": "capture", "path": str(path), "photos": sum(not photo.held_out for photo in photos)}
    facts |= {"held_out": sum(photo.held_out for photo in photos)}
    facts |= {"sizes": sorted({f"{header.width} x {header.height}" for header in headers})}
    facts |= {"masks": sum(photo.mask is not None or photo.mask_from_alpha for photo in photos)}
    facts |= {"focal_lengths_stated": sum(focal is not None for focal in focals)}
    facts |= {"videos": {video.name: _length(video) for video in videos}} if videos else {}
    notes = ["photos are taken from the videos by `ibrpipe run`"] if videos else []
    twins = sum(file.suffix.lower() in RAW_SUFFIXES for file in files_below(photo_root(path)))
    twins -= sum(Path(photo.image).suffix.lower() in RAW_SUFFIXES for photo in photos)
    notes += [f"{twins} raw files beside photos of the same name are left out"] if twins > 0 else []
    return facts | {"notes": [*notes, "no cameras: `ibrpipe run photos` finds them from the photos"]}


def _video(path: Path) -> Facts:
    facts: Facts = {"kind": "video", "path": str(path), **_length(path)}
    return facts | {"notes": [f"`ibrpipe run {path}` takes photos from it"]}


def _length(video: Path) -> Facts:
    from ibrpipe.io.videos.read import read_video_header

    header = read_video_header(video)
    facts: Facts = {"size": f"{header.width} x {header.height}", "frames": header.frames, "seconds": header.seconds}
    return facts | {"bytes": video.stat().st_size}


def _views(path: Path) -> Facts:
    from ibrpipe.io.views import read_views

    views = read_views(path)
    facts: Facts = {"kind": "views", "path": str(path), "photos": len(views.train), "held_out": len(views.test)}
    return facts | {"sizes": _sizes(views.train), "mesh": None if views.mesh is None else str(views.mesh)}


def _sizes(views: Sequence[Any]) -> list[str]:
    return sorted({f"{view.camera.width} x {view.camera.height}" for view in views})


def _run(path: Path) -> Facts:
    from ibrpipe.evaluation.metrics import read_metrics

    facts: Facts = {"kind": "run", "path": str(path)}
    stages = load_stages()
    if (path / RUN_NAME).is_file():  # single stages write none
        first = next((stage.name for stage in stages if read_manifest(path / stage.folder)), stages[0].name)
        known = RunDocument.read(path / RUN_NAME, "is no note of a run", first)
        facts |= known.model_dump(exclude={"settings"})
    facts["stages"] = {}
    for stage in stages:
        manifest = read_manifest(path / stage.folder)
        if manifest is not None:
            facts["stages"][stage.name] = _cost(manifest)
    metrics = path / products(stages)["metrics"].path
    if metrics.is_file():
        content = read_metrics(metrics)
        scores = content if content.views or content.training is None else content.training
        facts |= {name: _plain(getattr(scores, name)) for name in ("renderers", "baselines")} | {"bytes": content.bytes}
        facts |= {"not_measured": content.not_measured} if content.not_measured else {}
    return facts


def _plain(scores: Mapping[str, Document]) -> Facts:
    return {name: each.model_dump(mode="json") for name, each in scores.items()}


def _cost(manifest: Manifest) -> Facts:
    return {
        "seconds": manifest.seconds,
        "peak_memory_bytes": manifest.peak_memory_bytes,
        "bytes": sum(manifest.files.values()),
    }


def _reliefs(path: Path) -> Facts:
    from ibrpipe.io.documents.reliefs import ReliefsFile
    from ibrpipe.io.photos.image_files import read_header
    from ibrpipe.io.surfaces.reliefs import INDEX

    document = ReliefsFile.read(path / INDEX, "is no list of relief textures", "relief images")
    facts: Facts = {"kind": "relief textures", "path": str(path), "bytes": bytes_below(path)}
    facts |= {"generator": document.generator, "made_from": document.made_from, "textures": {}}
    for entry in document.reliefs:
        header = read_header(path / entry.file)
        own = {"texels": f"{header.width} x {header.height}", "file": entry.file, "joined": entry.joined}
        facts["textures"][entry.name] = own | ({} if entry.file.endswith(".exr") else {"step": entry.step})
    return facts


def _asset(path: Path) -> Facts:
    from ibrpipe.io.assets import bytes_by_kind, read_index

    index = read_index(path)
    facts: Facts = {"kind": "asset", "path": str(path), "bytes": bytes_below(path)}
    facts |= {"generator": index.generator, "units": index.units, "color_space": index.color_space}
    facts["photos"] = len(index.provenance.get("photos", []))
    facts["view_dependence_bytes"] = bytes_by_kind(index, path)
    facts["textures"] = {entry.name: _texture(path, entry) for entry in index.textures}
    if rungs := _rungs(index.provenance):
        facts["rungs"] = rungs
    if any("error" in entry.measured for entry in index.textures):
        facts["errors"] = {entry.name: _error(entry) for entry in index.textures}
    if any(entry.coding is not None for entry in index.textures):
        facts["coding"] = {entry.name: _coding(entry) for entry in index.textures}
    return facts


def _rungs(provenance: Facts) -> Facts:
    """Return what the plan took and dropped, from less to more data, with its figures."""
    told: Facts = {}
    reasons = provenance.get("reasons")
    for entry in reasons if isinstance(reasons, list) else ():
        if isinstance(entry, dict) and str(entry.get("what", "")).startswith("rung "):
            measured = entry.get("measured")
            figures = measured if isinstance(measured, dict) else {}
            kept = {name: figures[name] for name in ("psnr", "gain_db", "bytes") if name in figures}
            told[str(entry["what"]).split(": ")[-1]] = {"choice": entry.get("choice"), **kept}
    return told


def _texture(folder: Path, entry: TextureEntry) -> Facts:
    """Return the figures of one texture that are plain, those of its view dependence included."""
    from ibrpipe.io.assets import component_bytes

    facts: Facts = {"view_dependence": ", ".join(component.kind for component in entry.components) or "none"}
    layers, residuals = entry.measured.get("layers") or {}, entry.measured.get("residuals") or {}
    if "width" in layers:
        facts["texels"] = f"{layers['width']} x {layers['height']}"
    facts |= {name: layers[name] for name in ("samples", "most_layers", "seen_share") if name in layers}
    facts |= {f"residual_{name}": residuals[name] for name in ("directions", "texels") if name in residuals}
    facts["layers_bytes"] = (folder / entry.layers).stat().st_size
    facts["residual_bytes"] = sum(component_bytes(component, folder) for component in entry.components)
    return facts


def _error(entry: TextureEntry) -> Facts:
    """Return the error that is to be expected of a texture, and the worst of its tiles."""
    told = entry.measured.get("error")
    error: Facts = told if isinstance(told, dict) else {}
    names = ("measured_on", "pixels", "color_rms", "depth_rms", "coverage", "confidence")
    facts = {name: error.get(name) for name in names}
    tiles = error.get("tiles")
    known = [value for value in (tiles.get("color_rms") or [] if isinstance(tiles, dict) else []) if value is not None]
    return facts | {"worst_tile_color_rms": max(known, default=None)}


def _coding(entry: TextureEntry) -> Facts:
    """Return how the layers of a texture are coded, and what that lost; exactly = left out."""
    lost = entry.measured.get("coding") or {}
    names = ("color_psnr", "depth_error_rms", "depth_error_max", "normal_error_mean")
    said = {} if entry.coding is None else entry.coding.model_dump()
    return {"layers": "deep OpenEXR" if entry.coding is None else "pictures"} | said | {n: lost.get(n) for n in names}
