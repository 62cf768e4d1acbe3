"""What the JSON files of a run hold, as models: the source of their schemas and a check on those who write them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from ibrpipe.io.assets import AssetIndex

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Matrix33 = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Matrix34 = Annotated[list[Annotated[list[float], Field(min_length=4, max_length=4)]], Field(min_length=3, max_length=3)]
Share = Annotated[float, Field(ge=0, le=1)]


class _Document(BaseModel):
    model_config = ConfigDict(extra="forbid")


class View(_Document):
    """One photo and the pinhole camera that it is seen through."""

    name: str = Field(description="Unique among the train or among the test views, fit for a file name")
    image: str = Field(description="Photo file, relative to the document's root, or absolute")
    mask: str | None = Field(description="Mask file; null = none")
    mask_from_alpha: bool = Field(description="The photo's own alpha is the mask")
    mask_rule: Literal["coverage", "nonzero"] = Field(description="Values are coverage, or all but 0 count fully")
    mask_threshold: float | None = Field(
        None, description="Without a mask: what is brighter (display code, 0..1) is the object; null = all counts"
    )
    gain: float = Field(gt=0, description="Linear factor that undoes the photo's exposure")
    color_space: str | None = Field(description="Colour space of the photo; null = as the file declares")
    oriented: bool = Field(description="The file's orientation tag is obeyed")
    full_size: tuple[int, int] | None = Field(
        description="Width and height of the undistorted picture before shrinking; null = not shrunk"
    )
    depth: str | None = Field(
        description="File of known depth along camera z: truth of test views, or of an RGB-D camera; null = none"
    )
    held_out: bool = Field(description="For measuring only")
    width: int = Field(ge=1, description="Pixels")
    height: int = Field(ge=1, description="Pixels")
    K: Matrix33 = Field(description="Calibration, pixels; pixel (0, 0)'s centre is at (0.5, 0.5)")
    cam_from_world: Matrix34 = Field(description="Pose [R t], world to camera, OpenCV axes, scene units")
    distortion: tuple[str, list[float], int, int] | None = Field(
        description="COLMAP camera model, its parameters, width and height of the photo file; null = pinhole"
    )


class Views(_Document):
    """``ingest/views.json``."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this layout")
    root: str = Field(description="Folder that relative photo paths start from; empty = the document's own")
    mesh: str | None = Field(description="Mesh file, relative to this document")
    info: dict[str, Any] = Field(description="Capture folder, exposure source, notes")
    train: list[View] = Field(description="Photos that the asset is made from")
    test: list[View] = Field(description="Photos that it is measured on")


class Finding(_Document):
    """One thing that the audit found."""

    severity: Literal["error", "warning", "note"] = Field(description="Errors stop the pipeline")
    kind: str = Field(description="Short fixed word, such as blurred")
    file: str = Field(description="What it is about")
    value: str = Field(description="What was met")
    expected: str = Field(description="What would be right")
    remedy: str = Field(description="What to do")


class AuditedPhoto(_Document):
    """What was measured in one photo."""

    name: str = Field(description="Name of the view")
    held_out: bool = Field(description="For measuring only")
    sharpness: float = Field(description="Variance of the Laplacian over that of the coded luminance, in the mask")
    clipped: float = Field(description="Share of the mask's pixels with a channel at its top")
    black: float = Field(description="Share of the mask's pixels with all channels at the bottom")
    covered: Share = Field(description="Share of the picture that the mask keeps")
    seen: Share | None = Field(description="Share of the surface's area that the photo sees; null = no mesh")
    overlap: Share | None = Field(
        description="Mask against the mesh's outline, intersection over union; null = no mask or no mesh"
    )
    masked: bool = Field(description="A mask or alpha says which pixels count")


class AuditedSurface(_Document):
    """How well the photos see the surface."""

    unseen: Share = Field(description="Share of the area that no photo sees")
    fewer_than_3: Share = Field(description="Share of the area that fewer than three photos see")
    median_photos: int = Field(description="Photos that see a point, median over the area")
    share_by_photos: dict[str, float] = Field(description="Share of the area by number of photos; 10+ = ten or more")
    thin_center: Vector | None = Field(description="Mean place of what fewer than three photos see; null = none")
    thin_facing: Vector | None = Field(description="Mean normal of what fewer than three photos see; null = none")
    samples: int = Field(description="Points that were tried")


class Audit(_Document):
    """``ingest/audit.json``."""

    findings: list[Finding] = Field(description="Worst first")
    photos: list[AuditedPhoto] = Field(description="All photos that could be read")
    surface: AuditedSurface | None = Field(description="Coverage of the surface; null = no mesh")


class CalibratedLens(_Document):
    """A lens that was found or adjusted."""

    model: str = Field(description="COLMAP's name of the camera model")
    params: list[float] = Field(description="Its parameters, pixels of the photo file")
    width: int = Field(ge=1, description="Pixels")
    height: int = Field(ge=1, description="Pixels")
    photos: int = Field(ge=1, description="Photos that were taken with it")
    start: Literal["given", "settings", "exif", "guess"] = Field(description="Where the search started from")
    start_params: list[float] = Field(description="Parameters at the start")
    angle_of_view_deg: float = Field(description="Horizontal angle of view without distortion, degrees")
    principal_point_deviation_px: float | None = Field(
        description="Standard deviation of the principal point, pixels; null = it was not adjusted"
    )


class CalibratedPhoto(_Document):
    """A photo that was to be calibrated."""

    name: str = Field(description="Below images/; those of test/ begin with test/")
    registered: bool = Field(description="Its camera was found and is written")
    model: int | None = Field(description="Model that it is in; 0 is the one that is written; null = none")
    features: int = Field(ge=0, description="Features inside its mask")
    points: int = Field(ge=0, description="Points of the model that it sees")
    error_px: float | None = Field(description="Mean reprojection error, pixels; null = no point")
    best_partner: str | None = Field(description="Photo that it shares most matches with; null = none")
    best_matches: int = Field(ge=0, description="Those matches")


class CalibrationFinding(_Document):
    """What to know, and what to do."""

    severity: Literal["warning", "note"] = Field(description="Warnings ask for other photos")
    file: str = Field(description="What it is about")
    text: str = Field(description="What was met")
    remedy: str = Field(description="What to do")


class PhotoSpacing(_Document):
    """How far apart calibrated photos stand, told by what they share; medians over the photos."""

    nearest_deg: float = Field(description="Angle to the nearest partner at the points that both see, degrees")
    second_deg: float = Field(description="Angle to the second nearest")
    matched: float = Field(description="Share of a photo's features that match its best partner")
    widest: tuple[str, str] = Field(description="A photo and its nearest partner, where they are farthest apart")
    widest_deg: float = Field(description="Angle between these two")


class Spread(_Document):
    """Two figures of many values."""

    mean: float = Field(description="Mean")
    median: float = Field(description="Median")


class Calibration(_Document):
    """``calibrate/calibration.json``. All but the first three is left out where nothing was searched."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this layout")
    decision: Literal["given", "found", "refined"] = Field(
        description="given = the capture's own cameras are used as they are; found, refined = those of sparse/0"
    )
    reason: str = Field(description="Why, in words")
    registered: int | None = Field(None, description="Photos with a camera")
    photos_given: int | None = Field(None, description="Photos that were to be calibrated")
    points: int | None = Field(None, description="Sparse points")
    mean_track_length: float | None = Field(None, description="Photos that see a point, mean")
    reprojection_error_px: Spread | None = Field(None, description="Over all observations, pixels")
    world: Literal["given", "markers", "positions", "gps", "own"] | None = Field(
        None, description="Where origin, axes and unit come from; own = from the photos alone"
    )
    units: str | None = Field(None, description="The unit of length, in words")
    alignment: dict[str, Any] | None = Field(None, description="How the world was found, and how well it fits")
    lenses: list[CalibratedLens] = Field(default=[], description="All lenses")
    photos: list[CalibratedPhoto] = Field(default=[], description="All photos, the left-out ones included")
    other_models: list[list[str]] = Field(default=[], description="Photos that hang together but not with the rest")
    spacing: PhotoSpacing | None = Field(None, description="How far apart the photos stand; null = too few in common")
    findings: list[CalibrationFinding] = Field(default=[], description="What to know, and what to do")
    peak_memory_bytes: int | None = Field(None, description="Largest resident memory of the child process")


class DepthMapFacts(_Document):
    """Where the depth of a view comes from."""

    view: str = Field(description="Name of the view")
    neighbours: list[str] = Field(description="Views that it was matched with")
    angles: list[float] = Field(
        default=[], description="Angle to each of them at what both see, median, degrees; empty = depth was given"
    )
    seconds: float = Field(ge=0, description="What it took; 0 = taken over from an earlier run, or given")


class Geometry(_Document):
    """``geometry/geometry.json``."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this layout")
    decision: Literal["given", "depth", "photos"] = Field(
        description="given = the capture's own mesh, depth = from depth maps of the capture, photos = from photos"
    )
    reason: str = Field(description="Why this mesh or this way to it, in words")
    vertices: int = Field(ge=0, description="Vertices of mesh.ply")
    faces: int = Field(ge=0, description="Faces of mesh.ply")
    depth_from: str | None = Field(None, description="Where depth comes from; empty = only outlines were used")
    depth_maps: list[DepthMapFacts] | None = Field(None, description="The depth maps, a view each")
    spacing_deg: dict[str, float] | None = Field(
        None,
        description="Median angle from a photo to the nearest, second, fourth and farthest neighbour of those that its "
        "depth came from, degrees",
    )
    warnings: list[str] | None = Field(None, description="What to know, and what to shoot")
    method: Literal["volume", "poisson", "hull"] | None = Field(None, description="How depth became a surface")
    filled_by_outlines: bool | None = Field(None, description="The masks' outlines stand where no depth is")
    measured: dict[str, float] | None = Field(None, description="The figures behind the choice of the method")
    points: int | None = Field(None, description="Points that depth maps agree on")
    voxel: float | None = Field(None, description="Size of a voxel, scene units")
    voxel_wanted: float | None = Field(
        None, description="Size of a voxel that the settings ask for; it is smaller where memory did not suffice"
    )
    parts_dropped: int | None = Field(None, description="Connected parts that were too small to keep")
    moved_to_outlines: dict[str, float] | None = Field(
        None,
        description="Of the vertices moved to the masks' outlines: share; inferred = share moved more than a voxel, "
        "which stand where masks put them rather than depth; mean and most of all moves, voxels",
    )
    two_sided: dict[str, float | str] | None = Field(
        None,
        description="The second side of thin walls: share of the area that has one; share of the pixels that show "
        "backs in place; thickness (median, scene units); reason",
    )
    area: float | None = Field(None, description="Of the surface, square scene units")
    unseen_share: Share | None = Field(None, description="Share of the area that no depth map shows")
    looked_through_share: Share | None = Field(
        None, description="Share of the area that is kept to close the surface although depth maps look through it"
    )
    boundary_loops: int | None = Field(None, description="Open borders; 0 = closed")
    boundary_length: float | None = Field(None, description="Length of all open borders, scene units")
    crowded_edges: int | None = Field(None, description="Edges with more than two faces")
    closed: bool | None = Field(None, description="No open border")
    confidence: dict[str, float] | None = Field(None, description="Of the vertices: mean, and the least sure tenth")
    observations_median: int | None = Field(None, description="Depth maps that show a vertex, median")
    seconds: dict[str, float] | None = Field(None, description="Of depth, fusion and surface")
    coverage: AuditedSurface | None = Field(None, description="How well the photos see the surface")


class PlannedTexture(_Document):
    """A support rectangle and what is modelled on it."""

    name: str = Field(description="Name of the texture")
    projection: Literal["parallel", "perspective"] = Field(description="How rays leave the rectangle")
    origin: Vector = Field(description="World position of the corner where u = v = 0")
    u: Vector = Field(description="Whole edge along the columns, world")
    v: Vector = Field(description="Whole edge along the rows, world; u x v points into the scene")
    center: Vector | None = Field(description="Centre of a perspective projection, world; null = parallel")
    width: int = Field(ge=1, description="Texels along u")
    height: int = Field(ge=1, description="Texels along v")
    max_angle_deg: float = Field(description="Surfaces tilted further go to a texture that faces them better, degrees")
    max_layers: int = Field(ge=1, description="Layers at the most")
    residuals: bool = Field(description="Whether view dependence is modelled")
    k: float = Field(description="Spiral density: turns are 2 pi k apart")
    residual_scale: float = Field(description="Texels of a residual image per texel of the layers, along each edge")


class Reason(_Document):
    """A choice and why it was made."""

    what: str = Field(description="What was chosen")
    choice: Any = Field(description="The choice")
    reason: str = Field(description="Why, in words")
    measured: dict[str, Any] = Field(description="The figures behind it")


class Plan(_Document):
    """``plan/plan.json``."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this layout")
    textures: list[PlannedTexture] = Field(description="What is to be modelled")
    reasons: list[Reason] = Field(description="One for each choice")


class LayersFigures(BaseModel):
    """Figures of one texture's layered depth image."""

    name: str = Field(description="Name of the texture")
    width: int = Field(ge=1, description="Texels along u")
    height: int = Field(ge=1, description="Texels along v")
    samples: int = Field(ge=0, description="Depth samples in all layers")
    most_layers: int = Field(ge=0, description="Samples of the fullest texel")
    covered_texels: Share = Field(description="Share of the texels with a sample")
    seen_share: Share = Field(description="Share of the samples that a photo sees")
    depth_range: tuple[float, float] | None = Field(description="Nearest and farthest depth, scene units; null = empty")
    bytes: int = Field(ge=0, description="Size of layers.exr")


class Layers(_Document):
    """``layers/layers.json``."""

    textures: list[LayersFigures] = Field(description="All textures, in the order of the plan")
    training_psnr: list[float] = Field(
        description="PSNR of diffuse colours on the training photos, before every round of sharpening and at last, dB"
    )


class ResidualsFigures(BaseModel):
    """Figures of one texture's residuals."""

    name: str = Field(description="Name of the texture")
    texture: int = Field(ge=0, description="Index of the texture in the plan")
    directions: int = Field(ge=0, description="Residual images, one per direction of the spiral")
    texels: int = Field(ge=0, description="Texels of all images")
    valid_share: Share = Field(description="Share of the texels that hold a residual")
    clamped_texels: int = Field(ge=0, description="Valid texels with a channel outside the range of the code")
    clamped_share: Share = Field(description="Those over the valid ones")
    zero: int = Field(description="Code of a residual of nothing")
    encoding: Literal["8bit", "half"] = Field(description="How texels are stored")
    bytes: int = Field(ge=0, description="Size of the texture's residual file")


class Residuals(_Document):
    """``residuals/residuals.json``."""

    textures: list[ResidualsFigures] = Field(description="The textures that have residuals")
    training_psnr: list[float] = Field(
        default=[],
        description="PSNR of the training photos on exact geometry, dB: before every round of refinement, and at last",
    )


class RenderedFrame(_Document):
    """One picture of one renderer."""

    view: str = Field(description="Name of the view along the path")
    renderer: str = Field(description="Name of the renderer")
    file: str = Field(description="OpenEXR file: linear R G B, A, Z = depth along camera z, as far as asked for")
    png: str | None = Field(None, description="8-bit sRGB picture; absent without colour")
    ms: float = Field(ge=0, description="Milliseconds of the frame, median over the repeats")
    width: int = Field(ge=1, description="Pixels")
    height: int = Field(ge=1, description="Pixels")
    K: Matrix33 = Field(description="Calibration, pixels")
    cam_from_world: Matrix34 = Field(description="Pose [R t], world to camera, OpenCV axes, scene units")
    stats: dict[str, Any] = Field(description="Figures that the renderer tells")


class Frames(_Document):
    """``render/frames.json``."""

    path: str = Field(description="Camera path as the settings name it")
    renderers: list[str] = Field(description="Names, in the order asked for")
    videos: dict[str, str] = Field(description="Renderer to MP4 file")
    frames: list[RenderedFrame] = Field(description="All frames, renderer by renderer")


class Run(_Document):
    """``run.json``: what the last ``ibrpipe run`` in this folder was asked for."""

    pipeline: str = Field(description="Name of the pipeline")
    seed: int = Field(ge=0, description="The one seed")
    capture: str | None = Field(description="Capture folder, absolute")
    settings: dict[str, dict[str, Any]] = Field(description="Stage to all its settings, defaults included")


#: name of the schema -> model, and the place of the file in a run folder
DOCUMENTS: dict[str, tuple[type[BaseModel], str]] = {
    "asset": (AssetIndex, "asset/asset.json"),
    "audit": (Audit, "ingest/audit.json"),
    "calibration": (Calibration, "calibrate/calibration.json"),
    "frames": (Frames, "render/frames.json"),
    "geometry": (Geometry, "geometry/geometry.json"),
    "layers": (Layers, "layers/layers.json"),
    "plan": (Plan, "plan/plan.json"),
    "residuals": (Residuals, "residuals/residuals.json"),
    "run": (Run, "run.json"),
    "views": (Views, "ingest/views.json"),
}
