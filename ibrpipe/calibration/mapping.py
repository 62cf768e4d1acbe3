"""From matches to cameras and points: mapping, refinement of given poses, the last adjustment. Child process only."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ibrpipe.calibration.database import make_camera
from ibrpipe.calibration.features import Features
from ibrpipe.calibration.lenses import Start
from ibrpipe.io.cameras.colmap_write import ModelImage, SparseModel
from ibrpipe.io.cameras.lenses import Lens
from ibrpipe.native_imports import import_pycolmap
from ibrpipe.types import Array

#: The last adjustment weighs residuals by Cauchy's function of this many times the median residual
ROBUST = 1.5
#: The principal point is adjusted where so many photos share the lens, and kept when it stays within this share of the
#: photo's longer side and its standard deviation below this many pixels
SHARING, WANDER, UNSURE = 5, 0.06, 3.0
#: Median distance of a plane's normal distribution, over its standard deviation along one axis
_MEDIAN = 1.1774


def map_photos(path: Path, mapper: str, fixed: set[int], seed: int, registered: Callable[[int], None]) -> list[Any]:
    """Find poses and points of all photos of a database.

    Parameters
    ----------
    path : Path
        The database.
    mapper : {"incremental", "patient", "global"}
        One after the other; the same with fewer matches asked for; all at once.
    fixed : set of int
        Numbers of the cameras whose lens is known.
    seed : int
    registered : callable
        Called with the number of photos placed so far.

    Returns
    -------
    list of pycolmap.Reconstruction
        Largest first; photos that do not hang together come as several.
    """
    out = path.with_suffix(".models")
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    if mapper == "global":
        found = _global(path, out, seed)
    else:
        found = _incremental(path, out, pipeline_options(fixed, seed, mapper == "patient"), registered)
    shutil.rmtree(out, ignore_errors=True)
    kept = [model for model in found.values() if model.num_reg_images() >= 2]
    return sorted(kept, key=lambda model: (-model.num_reg_images(), min(model.reg_image_ids())))


def _incremental(path: Path, out: Path, options: Any, registered: Callable[[int], None]) -> Any:
    pycolmap = import_pycolmap()
    placed = 0

    def start() -> None:
        nonlocal placed
        placed = 2
        registered(placed)

    def step() -> None:
        nonlocal placed
        placed += 1
        registered(placed)

    return pycolmap.incremental_mapping(
        str(path), str(out), str(out), options, initial_image_pair_callback=start, next_image_callback=step
    )


def pipeline_options(fixed: set[int], seed: int, patient: bool = False) -> Any:
    """Return COLMAP's options: one thread, so that sums come in the same order every time.

    `patient` ones ask for fewer matches before a photo is placed: right for smooth things with few features.
    """
    options = import_pycolmap().IncrementalPipelineOptions()
    options.num_threads = options.mapper.num_threads = 1
    for part in (options, options.mapper, options.triangulation):
        part.random_seed = seed
    options.extract_colors = False
    options.min_model_size = 3
    if patient:
        options.mapper.init_min_num_inliers, options.mapper.init_min_tri_angle = 30, 8.0
        options.mapper.abs_pose_min_num_inliers, options.mapper.abs_pose_min_inlier_ratio = 12, 0.15
    options.constant_cameras = options.mapper.constant_cameras = fixed
    return options


def _global(path: Path, out: Path, seed: int) -> Any:
    pycolmap = import_pycolmap()
    copy = out / "copy.db"
    shutil.copyfile(path, copy)
    views = pycolmap.ViewGraphCalibrationOptions()
    views.random_seed = seed
    pycolmap.calibrate_view_graph(str(copy), views)
    options = pycolmap.GlobalPipelineOptions()
    options.num_threads = options.mapper.num_threads = 1
    for part in (options, options.mapper, options.mapper.rotation_averaging, options.mapper.global_positioning):
        part.random_seed = seed
    options.mapper.global_positioning.use_gpu = False
    options.mapper.bundle_adjustment.ceres.use_gpu = False
    return pycolmap.global_mapping(str(copy), str(out), str(out), options)


def triangulate(path: Path, starts: Sequence[Start], owner: Sequence[int], poses: dict[int, Array], seed: int) -> Any:
    """Return the model of photos whose poses are given: points from the matches, poses and lenses as they are.

    Parameters
    ----------
    path : Path
        The database.
    starts, owner
        Lenses, and the lens of each photo.
    poses : dict of int to (3, 4) float64
        Index of a photo to its ``cam_from_world``.
    seed : int
    """
    pycolmap = import_pycolmap()
    model = pycolmap.Reconstruction()
    for key, start in enumerate(starts, 1):
        model.add_camera_with_trivial_rig(make_camera(start, key))
    for index, pose in sorted(poses.items()):
        image = pycolmap.Image(name=f"{index:06d}", camera_id=owner[index] + 1)
        image.image_id = index + 1
        rigid = pycolmap.Rigid3d(pycolmap.Rotation3d(np.asarray(pose[:, :3])), np.asarray(pose[:, 3]))
        model.add_image_with_trivial_frame(image, rigid)
    out = path.with_suffix(".models")
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    options = pipeline_options(set(range(1, len(starts) + 1)), seed)
    found = pycolmap.triangulate_points(model, str(path), str(out), str(out), True, options, False)
    shutil.rmtree(out, ignore_errors=True)
    return found


def adjust(model: Any, starts: Sequence[Start], fixed: set[int], center: bool) -> dict[int, float]:
    """Adjust poses, points and lenses together with a robust weight; lenses in `fixed` stay.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Changed in place.
    starts : sequence of Start
    fixed : set of int
        Numbers of cameras that are known.
    center : bool
        Principal points may be adjusted, too, where enough photos share a lens.

    Returns
    -------
    dict
        Number of each camera whose principal point was adjusted, to its standard deviation in pixels.
    """
    free = _sharing(model) - fixed if center else set()
    before = {key: np.array(model.cameras[key].params) for key in free}
    found = _bundle(model, fixed, free)
    wild = {key for key in free if found.get(key, np.inf) > UNSURE or _wandered(model.cameras[key])}
    if wild:
        for key in wild:
            model.cameras[key].params = before[key]
        found = _bundle(model, fixed, free - wild)
    return {key: found[key] for key in sorted(free - wild) if key in found}


def _sharing(model: Any) -> set[int]:
    owners = [model.images[key].camera_id for key in model.reg_image_ids()]
    return {key for key in set(owners) if owners.count(key) >= SHARING}


def _wandered(camera: Any) -> bool:
    size = np.array([camera.width, camera.height])
    point = np.array([camera.principal_point_x, camera.principal_point_y])
    return bool(np.abs(point - size / 2.0).max() > WANDER * size.max())


def _bundle(model: Any, fixed: set[int], free: set[int]) -> dict[int, float]:
    """One adjustment; returns standard deviations of the free principal points, pixels."""
    pycolmap = import_pycolmap()
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.min_track_length = 2
    options.refine_focal_length = options.refine_extra_params = True
    options.refine_principal_point = bool(free)
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    middle = max(_median_error(model), 1e-3)
    options.ceres.loss_function_scale = ROBUST * middle
    options.ceres.use_gpu = False
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.function_tolerance = 1e-8
    config = pycolmap.BundleAdjustmentConfig()
    for key in model.reg_image_ids():
        config.add_image(key)
    for key in fixed & set(model.cameras):
        config.set_constant_cam_intrinsics(key)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
    adjuster.solve()
    deviations = _deviations(adjuster, model, free, middle / _MEDIAN) if free else {}
    model.update_point_3d_errors()
    return deviations


def _deviations(adjuster: Any, model: Any, free: set[int], noise: float) -> dict[int, float]:
    """Standard deviations of principal points, the larger of x and y, in pixels; lenses without one are left out."""
    pycolmap = import_pycolmap()
    options = pycolmap.BACovarianceOptions()
    options.params = pycolmap.BACovarianceOptionsParams.ALL
    covariance = pycolmap.estimate_ba_covariance(options, model, adjuster)
    found: dict[int, float] = {}
    for key in free if covariance is not None else ():
        camera = model.cameras[key]
        matrix = covariance.get_other_params_cov(camera.params)
        if matrix is not None and len(matrix) == len(camera.params):
            variance = np.diag(matrix)[camera.principal_point_idxs()]
            found[key] = noise * float(np.sqrt(np.maximum(variance, 0.0).max()))
    return found


def _median_error(model: Any) -> float:
    model.update_point_3d_errors()
    return float(np.median([point.error for point in model.points3D.values()] or [1.0]))


def observations(model: Any) -> dict[int, int]:
    """Return how many points each photo of a model sees, by index."""
    return {key - 1: int(model.images[key].num_points3D) for key in model.reg_image_ids()}


def as_sparse_model(model: Any, names: Sequence[str], features: Sequence[Features]) -> SparseModel:
    """Return a model as plain arrays, its points in the order of the first photo and feature that see them.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Image i + 1 is photo i.
    names : sequence of str
        Of the photos.
    features : sequence of Features
        Give the points' colours.
    """
    tracks = {
        key: sorted((element.image_id - 1, element.point2D_idx) for element in point.track.elements)
        for key, point in model.points3D.items()
    }
    order = sorted(tracks, key=lambda key: tracks[key])
    index_of = {key: index for index, key in enumerate(order)}
    lenses = sorted({model.images[key].camera_id for key in model.reg_image_ids()})
    images = [_image(model.images[key], names[key - 1], lenses, index_of) for key in sorted(model.reg_image_ids())]
    rgb = [np.mean([features[i].colors[k] for i, k in tracks[key]], axis=0) for key in order]
    return SparseModel(
        tuple(_lens(model.cameras[key]) for key in lenses),
        tuple(images),
        np.array([model.points3D[key].xyz for key in order]).reshape(-1, 3),
        np.rint(np.array(rgb).reshape(-1, 3)).astype(np.uint8),
        np.array([model.points3D[key].error for key in order], np.float64),
    )


def _image(image: Any, name: str, lenses: Sequence[int], index_of: dict[int, int]) -> ModelImage:
    seen = [(spot.xy, index_of[spot.point3D_id]) for spot in image.points2D if spot.has_point3D()]
    pixels = np.array([pixel for pixel, _ in seen]).reshape(-1, 2)
    pose = np.array(image.cam_from_world().matrix())
    lens = lenses.index(image.camera_id)
    return ModelImage(name, lens, pose, pixels, np.array([point for _, point in seen], np.int64))


def _lens(camera: Any) -> Lens:
    params = tuple(float(value) for value in camera.params)
    return Lens(camera.model_name, params, int(camera.width), int(camera.height))
