"""An asset as a glTF binary file, which browsers, Blender and game engines open."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ibrpipe.export.registry import Exporter
from ibrpipe.export.surface.environment import surroundings
from ibrpipe.export.surface.fidelity import Fidelity
from ibrpipe.export.surface.gltf import glb_bytes, ior_of
from ibrpipe.export.surface.model import build_model
from ibrpipe.export.surface.painter import paint, read_back
from ibrpipe.export.surface.pictures import encode_pictures
from ibrpipe.export.surface.settings import GltfOptions
from ibrpipe.export.surface.source import Exported, read_source
from ibrpipe.export.whole_file import megabytes, write_files
from ibrpipe.types import Camera, Frame
from ibrpipe.types.reflection import ReflectedLight, Reflection

#: settings where none are given
DEFAULTS = GltfOptions()


def write(source: Path, target: Path, options: GltfOptions = DEFAULTS) -> str:
    """Write the asset in folder `source` as the file `target`; return what it is and what it loses.

    Where the asset mirrors its surroundings, those are written beside it, ``NAME.surroundings.hdr``.

    Raises
    ------
    MissingFileError, FormatError
        The asset is missing, damaged, or shows nothing.
    ConfigError, ResourceError
        The file cannot be written.
    """
    given = read_source(source, target)
    lit, light = options.material == "lit", reflected_light(given)
    model = build_model(given.asset, given.cameras, options.tolerance, diffuse=lit)
    pictures = encode_pictures(model, options.texture, options.quality, lit)
    extras = {"ibrpipe": _record(given, options, light)}
    shown = light if lit else None

    def content() -> bytes:
        return glb_bytes(model, pictures, given.gltf_from_world, shown, given.name, extras)

    fidelity = None
    if options.measure:
        draft = target.with_name(f".{target.name}.measured.partial")
        write_files(draft.parent, {draft.name: content()})
        try:
            fidelity = _measured(given, draft, lit)
        finally:
            draft.unlink(missing_ok=True)
        extras["ibrpipe"]["measured"] = fidelity.record()
    pictures_beside = [] if light is None else surroundings(light, given.gltf_from_world)
    names = [f"{target.stem}.surroundings{index or ''}.hdr" for index in range(len(pictures_beside))]
    written = content()
    write_files(target.parent, {**dict(zip(names, pictures_beside)), target.name: written})
    told = f"{model.told()}, {megabytes(len(written))}"
    beside = f"; beside it {', '.join(names)}" if names else ""
    return told + beside + ("" if fidelity is None else f"; {fidelity.told()}")


def reflected_light(given: Exported) -> ReflectedLight | None:
    """Return what an asset mirrors, if it mirrors anything."""
    found = given.asset.shared.get(Reflection.kind)
    return found if isinstance(found, ReflectedLight) else None


def _record(given: Exported, options: GltfOptions, light: ReflectedLight | None) -> dict[str, Any]:
    record: dict[str, Any] = {
        "units": given.units or "unknown",
        "gltf_from_world": given.gltf_from_world.tolist(),
        "settings": options.model_dump(mode="json"),
    }
    if light is not None:
        record["reflection"] = {
            "reflectance": list(light.reflectance),
            "damping": light.damping,
            "ior": [ior_of(each) for each in light.reflectance],
        }
    return record


def _measured(given: Exported, draft: Path, lit: bool) -> Fidelity:
    read = read_back(draft, given.gltf_from_world)

    def draw(camera: Camera) -> Frame:
        return paint(read, camera, 4)

    return given.measure(draw, diffuse=lit)


EXPORTER = Exporter(
    "glb", "Mesh with an atlas as glTF binary, for browsers, Blender, engines.", write, (".glb",), Options=GltfOptions
)
