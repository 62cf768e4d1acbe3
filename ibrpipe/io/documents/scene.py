"""What ``scene.yaml`` holds: a hierarchy of parts, their meshes and captured sources, and where copies stand."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ibrpipe.config import Document, Vector

_Row = Annotated[list[float], Field(min_length=4, max_length=4)]
Positive = Annotated[float, Field(gt=0)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]


class Rotation(Document):
    """A turn about an axis through the origin."""

    axis: Vector = Field(description="Direction; any length but 0")
    degrees: float = Field(description="Counter-clockwise seen from the axis's tip")

    @model_validator(mode="after")
    def _axis_is_one(self) -> Self:
        if not any(self.axis):
            raise ValueError("the axis is 0 0 0; give a direction")
        return self


class Placement(Document):
    """Where one copy stands: a matrix, or a scale, then turns, then a move."""

    matrix: Annotated[list[_Row], Field(min_length=3, max_length=4)] | None = Field(
        None, description="Affine matrix, 3 or 4 rows of 4 numbers, from the copied part to the part that holds it"
    )
    scale: float | Vector | None = Field(None, description="Factor, or one for each axis of the copied part")
    rotate: Rotation | list[Rotation] | None = Field(None, description="Turn, or several, the first one first")
    translate: Vector | None = Field(None, description="Scene units")

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if self.matrix is not None and (self.scale, self.rotate, self.translate) != (None, None, None):
            raise ValueError("a matrix stands beside translate, rotate or scale; give one or the other")
        return self


class Copies(Document):
    """Copies of one part."""

    part: str = Field(description="Name of the part that is copied")
    at: list[Placement] | None = Field(None, description="Where; one copy as it is unless given")
    matrices: str | None = Field(None, description="Where: .npy file, (N, 4, 4) or (N, 3, 4) float")

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if self.at is not None and self.matrices is not None:
            raise ValueError("at stands beside matrices; give one or the other")
        return self


class MeshFile(Document):
    """A mesh file, in the part's coordinates."""

    file: str = Field(description="PLY, OBJ, GLB/glTF or STL; nodes of a glTF are joined")
    color: Vector | None = Field(None, description="Diffuse albedo, linear, instead of the file's own colours")
    specular: float = Field(0.0, ge=0, le=1e4, description="Strength of the highlight (Blinn-Phong)")
    shininess: float = Field(32.0, ge=1, le=1e4, description="Exponent of the highlight")


class Frame(Document):
    """Parallel frame: X = origin + u a + v b + d f."""

    origin: Vector
    a: Vector
    b: Vector
    f: Vector


class Relief(Document):
    """A relief texture: folder of a height map and its colours, on a rectangle or in a frame."""

    folder: str = Field(description="Holds height.* and color.*, as ibrpipe relief images reads them")
    size: Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = Field(
        None, description="Width and height, scene units; columns then run along +x, rows along -y, heights along +z"
    )
    frame: Frame | None = Field(None, description="Instead of the size: texel (0, 0)'s outer corner, and the steps")
    depth_range: Pair | None = Field(None, description="Heights of code 0 and of full scale, scene units")

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if (self.size is None) == (self.frame is None):
            raise ValueError("give size or frame, one of them")
        return self


class ReliefMapping(Document):
    """A mesh with a relief mapped onto its polygons."""

    file: str = Field(description="Mesh file")
    relief: str | None = Field(None, description="Folder with height.*, color.*, normal_gl.*; else the material's own")
    thickness: Positive | None = Field(None, description="Height 0 to 1, scene units")
    repeat: Annotated[list[Positive], Field(min_length=2, max_length=2)] = Field(
        [1.0, 1.0], description="Tiles along u and along v"
    )


class ScenePart(Document):
    """A part: what it holds itself, and copies of others. Or all of another scene."""

    meshes: list[MeshFile] = Field([], description="Mesh files")
    assets: list[str] = Field([], description="Asset folders")
    reliefs: list[Relief] = Field([], description="Relief textures")
    relief_meshes: list[ReliefMapping] = Field([], description="Meshes with reliefs mapped onto them")
    scene: str | None = Field(
        None, description="Scene folder, scene.yaml, or GLB/glTF file with its nodes as parts; its root is held once"
    )
    children: list[Copies] = Field([], description="Copies of other parts")


class SceneLight(Document):
    """A light at infinity."""

    direction: Vector = Field(description="From the scene to the light, world axes")
    color: Vector = Field([1.0, 1.0, 1.0], description="What a white matt surface facing the light reflects, linear")


class SceneLighting(Document):
    """What lights the scene."""

    ambient: Vector = Field([0.35, 0.35, 0.35], description="Linear")
    lights: list[SceneLight] = Field([], description="Lights at infinity")


class SceneDocument(Document):
    """``scene.yaml``. Names of files are those inside its folder."""

    version: Literal[1] = Field(description="Of this form")
    generator: str | None = Field(None, description="Program that wrote the folder; absent = made by hand")
    root: str = Field(description="Name of the part that is the scene; its coordinates are the world's")
    lighting: SceneLighting | None = Field(None, description="The usual ambient light and sun unless given")
    parts: dict[str, ScenePart] = Field(description="All parts by name")
