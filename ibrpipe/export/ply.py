"""An asset as PLY: its samples as a mesh or as points, in the world as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.export.asset_folders import CONFIDENCE, MESH
from ibrpipe.export.registry import Exporter
from ibrpipe.export.surface.charts import charts_of
from ibrpipe.export.surface.colors import mean_colors
from ibrpipe.export.surface.model import shown_samples
from ibrpipe.export.surface.settings import PlyOptions
from ibrpipe.export.surface.source import Exported, read_source
from ibrpipe.export.whole_file import megabytes, write_files
from ibrpipe.io.surfaces.meshes import read_mesh, read_vertex_values
from ibrpipe.types import Array
from ibrpipe.types.bounds import sample_positions

_KINDS = {"<f8": "double", "<f4": "float", "<i4": "int", "|u1": "uchar"}

#: settings where none are given
DEFAULTS = PlyOptions()


def write(source: Path, target: Path, options: PlyOptions = DEFAULTS) -> str:
    """Write the asset in folder `source` as `target`; return what was written.

    Every sample that a photo sees is a vertex: x, y, z (world, scene units), nx, ny, nz, red, green, blue (sRGB),
    observers (photos that its colour comes from; where known) and confidence (of the run's mesh there; where known).

    Raises
    ------
    MissingFileError, FormatError
        The asset is missing, damaged, or shows nothing.
    ConfigError, ResourceError
        The file cannot be written.
    """
    given = read_source(source, target)
    table, faces = vertices_of(given, options.content == "mesh")
    confidence = _confidence(source.parent / MESH, table)
    if confidence is not None:
        table = _with(table, CONFIDENCE, confidence)
    content = ply_bytes(table, faces if options.content == "mesh" else None)
    write_files(target.parent, {target.name: content})
    what = f"{len(table)} vertices" + (f", {len(faces)} triangles" if options.content == "mesh" else "")
    return f"{what}, {megabytes(len(content))}"


def ply_bytes(table: Array, faces: Array | None) -> bytes:
    """Return a binary PLY of vertices, a structured array, and triangles (F, 3)."""
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    lines += [f"property {_KINDS[table.dtype[name].str]} {name}" for name in table.dtype.names or ()]
    body = table.tobytes()
    if faces is not None:
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
        rows = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
        rows["count"], rows["corners"] = 3, faces
        body += rows.tobytes()
    return ("\n".join([*lines, "end_header"]) + "\n").encode("ascii") + body


def vertices_of(given: Exported, wanted: bool) -> tuple[Array, Array]:
    """Vertices of all textures as one structured array, and triangles (F, 3) between them if they are wanted."""
    tables, faces, start = [], [np.zeros((0, 3), np.int64)], 0
    counted = all(each.layers.observers is not None for each in given.asset.textures)
    for texture in given.asset.textures:
        shown, places = shown_samples(texture.layers), sample_positions(texture.layers)
        number = start + np.cumsum(shown) - 1
        for chart in charts_of(texture.layers, shown) if wanted else ():
            corners = chart.vertex_samples[chart.faces]
            faces.append(number[corners[((corners >= 0) & shown[corners]).all(axis=1)]])
        color = to_bytes(srgb_encode(mean_colors(texture, places, given.cameras)[shown]))
        normal = np.where(np.isfinite(texture.layers.normal), texture.layers.normal, 0.0)[shown]
        columns = dict(zip(("x", "y", "z"), places[shown].astype("<f8").T))
        columns |= dict(zip(("nx", "ny", "nz"), normal.astype("<f4").T))
        columns |= dict(zip(("red", "green", "blue"), color.T))
        if counted and texture.layers.observers is not None:
            columns["observers"] = texture.layers.observers[shown].astype("<i4")
        tables.append(_table(columns))
        start += int(shown.sum())
    return np.concatenate(tables), np.concatenate(faces)


def _table(columns: dict[str, Array]) -> Array:
    count = len(columns["x"])
    out = np.empty(count, [(name, values.dtype.str) for name, values in columns.items()])
    for name, values in columns.items():
        out[name] = values
    return out


def _with(table: Array, name: str, values: Array) -> Array:
    return _table({each: table[each] for each in table.dtype.names or ()} | {name: values.astype("<f4")})


def _confidence(path: Path, table: Array) -> Array | None:
    """Confidence of the run's mesh at its vertex nearest to every row; None where the run knows none."""
    if not path.is_file():
        return None
    known = read_vertex_values(path).get(CONFIDENCE)
    if known is None:
        return None
    from scipy.spatial import cKDTree

    vertices = read_mesh(path).vertices
    places = np.stack([table[axis] for axis in "xyz"], axis=1)
    return known[cKDTree(vertices).query(places, workers=-1)[1]]


EXPORTER = Exporter("ply", "Samples as a mesh or as points, in PLY.", write, (".ply",), Options=PlyOptions)
