"""What renderers are given to render, said once."""

from __future__ import annotations

from ibrpipe.types.relief_mesh import ReliefMesh
from ibrpipe.types.texture import Texture
from ibrpipe.types.textures import DepthImage, LayeredDepthImage, ReliefTexture

#: a surface as depths on a grid of texels
GridSource = ReliefTexture | DepthImage | LayeredDepthImage | Texture

#: everything that is rendered as one source; assets and lists are rendered as the sources that they hold
Renderable = GridSource | ReliefMesh
