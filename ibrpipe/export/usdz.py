"""An asset as USDZ, which phones and tablets of Apple's open in augmented reality: text of USD and a picture, archived.

USDZ is an archive without compression whose files begin at multiples of 64 bytes; the text form of USD is part of it,
so that nothing else is needed to write it (as openusd.org specifies USDZ 1.3).
"""

from __future__ import annotations

import io
import struct
from collections.abc import Mapping
from pathlib import Path
from zipfile import ZIP_STORED, ZipFile, ZipInfo

from ibrpipe.export.registry import Exporter
from ibrpipe.export.surface.gltf import unit_floats
from ibrpipe.export.surface.model import SurfaceModel, build_model
from ibrpipe.export.surface.pictures import encode, shrunk
from ibrpipe.export.surface.placement import rotation_of
from ibrpipe.export.surface.settings import SurfaceOptions
from ibrpipe.export.surface.source import read_source
from ibrpipe.export.whole_file import megabytes, write_files
from ibrpipe.types import Array

#: settings where none are given
DEFAULTS = SurfaceOptions()
#: files begin at multiples of this
ALIGNMENT = 64
#: of the field that pads a file's header, one that nobody else uses
_PADDING = 0x1986
_SCENE, _PICTURE = "scene.usda", "color.png"
#: a surface that shines with the photographed colours and reflects no light: colours hold their light already
_MATERIAL = f"""
    def Material "Material"
    {{
        token outputs:surface.connect = </Object/Material/Surface.outputs:surface>

        def Shader "Surface"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0, 0, 0)
            color3f inputs:emissiveColor.connect = </Object/Material/Picture.outputs:rgb>
            float inputs:opacity.connect = </Object/Material/Picture.outputs:a>
            float inputs:opacityThreshold = 0.5
            float inputs:roughness = 1
            color3f inputs:specularColor = (0, 0, 0)
            int inputs:useSpecularWorkflow = 1
            token outputs:surface
        }}

        def Shader "Picture"
        {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @{_PICTURE}@
            token inputs:sourceColorSpace = "sRGB"
            float2 inputs:st.connect = </Object/Material/Place.outputs:result>
            token inputs:wrapS = "clamp"
            token inputs:wrapT = "clamp"
            float outputs:a
            float3 outputs:rgb
        }}

        def Shader "Place"
        {{
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }}
    }}
"""


def write(source: Path, target: Path, options: SurfaceOptions = DEFAULTS) -> str:
    """Write the asset in folder `source` as the one file `target`; takes, returns and raises what `obj.write` does."""
    given = read_source(source, target)
    model = build_model(given.asset, given.cameras, options.tolerance)
    scene = _scene(model, given.gltf_from_world).encode("ascii")
    content = packed({_SCENE: scene, _PICTURE: encode(shrunk(model.color), "png", 0)})
    write_files(target.parent, {target.name: content})
    return f"{model.told()}, {megabytes(len(content))}"


def packed(files: Mapping[str, bytes]) -> bytes:
    """Return files, the scene first, as an archive whose files begin at multiples of `ALIGNMENT` bytes."""
    archive = io.BytesIO()
    with ZipFile(archive, "w", ZIP_STORED) as writer:
        for name, content in files.items():
            entry = ZipInfo(name)  # dated 1980: the same asset gives the same bytes
            header = archive.tell() + 30 + len(name) + 4
            room = -header % ALIGNMENT
            entry.extra = struct.pack("<HH", _PADDING, room) + bytes(room)
            writer.writestr(entry, content)
    return archive.getvalue()


def _scene(model: SurfaceModel, gltf_from_world: Array) -> str:
    turn = rotation_of(gltf_from_world)
    places = model.vertices @ gltf_from_world[:3, :3].T + gltf_from_world[:3, 3]
    normals = unit_floats(model.normals @ turn.T)
    corners = ", ".join(map(str, model.faces.ravel().tolist()))
    return f"""#usda 1.0
(
    defaultPrim = "Object"
    metersPerUnit = 1
    upAxis = "Y"
)

def Xform "Object" (
    kind = "component"
)
{{
    def Mesh "Surface" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        uniform bool doubleSided = 0
        float3[] extent = [{_rows([places.min(axis=0), places.max(axis=0)], 9)}]
        int[] faceVertexCounts = [{", ".join(["3"] * len(model.faces))}]
        int[] faceVertexIndices = [{corners}]
        rel material:binding = </Object/Material>
        normal3f[] normals = [{_rows(normals, 5)}] (
            interpolation = "vertex"
        )
        point3f[] points = [{_rows(places, 9)}]
        texCoord2f[] primvars:st = [{_rows(model.uv * [1, -1] + [0, 1], 7)}] (
            interpolation = "vertex"
        )
        uniform token subdivisionScheme = "none"
    }}
{_MATERIAL}}}
"""


def _rows(values: Array | list[Array], digits: int) -> str:
    """Return vectors as USD writes them."""
    rows = (", ".join(f"{each:.{digits}g}" for each in row.tolist()) for row in values)
    return ", ".join(f"({row})" for row in rows)


EXPORTER = Exporter(
    "usdz", "Mesh with an atlas as USDZ, for augmented reality on Apple's devices.", write, (".usdz",),
    Options=SurfaceOptions,
)  # fmt: skip
