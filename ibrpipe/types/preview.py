"""What notebooks show of an asset: at once, for no renderer is started.

The picture is a texture's front layer as it lies in memory, which is the object as its window sees it.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ibrpipe.types.camera import Camera
from ibrpipe.types.frame import Frame
from ibrpipe.types.texture import Texture
from ibrpipe.types.textures import LayeredDepthImage

#: edge of the picture at the most, pixels
LONGEST = 320
MORE = "<code>ibrpipe view FOLDER</code> shows it from all sides; <code>ibrpipe.export(asset, 'page.html')</code> too."


def preview_html(textures: Sequence[Texture], info: Mapping[str, Any]) -> str:
    """Return a picture of a texture and the facts as HTML; texts of the asset are escaped."""
    samples = [len(texture.layers.depth) for texture in textures]
    kinds = dict.fromkeys(part.kind for texture in textures for part in texture.components)
    facts = {
        "textures": str(len(textures)),
        "samples": f"{sum(samples):,}",
        "view dependence": ", ".join(kinds) or "none",
        "units": str(info.get("units", "")) or "unknown",
    }
    rows = "".join(f"<tr><th>{name}</th><td>{html.escape(value)}</td></tr>" for name, value in facts.items() if value)
    picture = ""
    if sum(samples):
        png = front_picture(max((texture.layers for texture in textures), key=_worth_seeing))._repr_png_() or b""
        code = base64.b64encode(png).decode("ascii")
        picture = f'<img alt="Diffuse colours, as a window sees them" src="data:image/png;base64,{code}">'
    return f"<div>{picture}<table>{rows}</table><p>{MORE}</p></div>"


def _worth_seeing(layers: LayeredDepthImage) -> float:
    """Return the number of samples, less where the window looks along z: things are known by their sides."""
    along = abs(float(layers.frame.f[2])) if not isinstance(layers.frame, Camera) else 0.0
    return len(layers.depth) * (1.1 - along)


def front_picture(layers: LayeredDepthImage) -> Frame:
    """Return colour and alpha of the nearest sample of every texel, thinned to `LONGEST`, not mirrored, z up.

    What no photo sees is left out; `color` (h, w, 3) linear light, `alpha` (h, w).
    """
    every = -(-max(layers.shape) // LONGEST)
    there = (np.diff(layers.offsets, axis=1) > 0)[::every, ::every]
    nearest = np.where(there, layers.offsets[::every, :-1:every], 0)
    if layers.observers is not None:
        there &= layers.observers[nearest] > 0
    color = np.where(there[..., None], layers.color[nearest], 0.0).astype(np.float32)
    turns = _upright(layers)
    return Frame(color[turns], None, there[turns].astype(np.float32))


def _upright(layers: LayeredDepthImage) -> tuple[slice, slice]:
    """Return rows and columns in the order in which a picture has them; a camera's are in order."""
    frame, back = layers.frame, slice(None, None, -1)
    if isinstance(frame, Camera):
        return slice(None), slice(None)
    mirrored = np.cross(frame.a, frame.b) @ frame.f < 0
    down = -frame.b[2] if mirrored else frame.b[2]
    rows = mirrored != (down > 0)
    return back if rows else slice(None), back if down > 0 else slice(None)
