"""What the pipeline speaks of: cameras, frames of reference, textures, assets, rendered frames.

Conventions (all of them are explained in ``docs/concepts.md``): OpenCV camera axes (x right, y down, z forward);
``cam_from_world`` maps world points to camera points; the centre of pixel (0, 0) is at (0.5, 0.5); colour is linear
light with Rec.709 primaries; rays and poses are float64, stored arrays float32; indices are int32 or int64.
"""

from ibrpipe.types.arrays import Array
from ibrpipe.types.asset import Asset
from ibrpipe.types.camera import Camera, ParallelFrame
from ibrpipe.types.frame import Frame
from ibrpipe.types.kept_photos import Blend, KeptPhoto, KeptPhotos, PhotoBlend
from ibrpipe.types.lighting import Light, Lighting
from ibrpipe.types.mesh import Mesh
from ibrpipe.types.parts import Instances, PaintedMesh, Part
from ibrpipe.types.reflection import ReflectedLight, Reflection
from ibrpipe.types.scene import Scene
from ibrpipe.types.texture import SpiralTexture, Texture
from ibrpipe.types.textures import DepthImage, LayeredDepthImage, ReliefTexture
from ibrpipe.types.view_dependence import SpiralResiduals, ViewDependence

__all__ = [
    "Array",
    "Asset",
    "Blend",
    "Camera",
    "DepthImage",
    "Frame",
    "Instances",
    "KeptPhoto",
    "KeptPhotos",
    "LayeredDepthImage",
    "Light",
    "Lighting",
    "Mesh",
    "PaintedMesh",
    "ParallelFrame",
    "Part",
    "PhotoBlend",
    "ReflectedLight",
    "Reflection",
    "ReliefTexture",
    "Scene",
    "SpiralResiduals",
    "SpiralTexture",
    "Texture",
    "ViewDependence",
]
