"""Do surveyed cameras and photos agree? python docs/figures/survey.py MODEL SURVEY [--jackknife].

The points and observations of a calibration are adjusted four times with one robust weight: with the surveyed poses
and lens, with either, and with neither. With --jackknife also the free lens without each of the photos in turn.
MODEL is RUN/calibrate/sparse/0 of a calibration with the surveyed lens.
"""

import sys
from pathlib import Path

import numpy as np

from ibrpipe.core.similarity import fit_cameras
from ibrpipe.native_imports import import_pycolmap

#: Cauchy's weight over the median error, and that over the noise of one coordinate
ROBUST, MEDIAN = 1.5, 1.1774
pycolmap = import_pycolmap()
pycolmap.logging.minloglevel = 2
survey = pycolmap.Reconstruction()
survey.read(sys.argv[2])
surveyed = {Path(image.name).name: image for image in survey.images.values()}
lens = next(iter(survey.cameras.values()))


def fresh():
    """The calibration with the surveyed lens."""
    model = pycolmap.Reconstruction()
    model.read(sys.argv[1])
    (key,) = model.cameras
    model.cameras[key].model, model.cameras[key].params = lens.model, lens.params
    return model


def poses(images) -> np.ndarray:
    """cam_from_world of images, (N, 3, 4)."""
    return np.array([image.cam_from_world().matrix() for image in images])


def take_poses(model) -> None:
    """Move a model to the survey and give its photos the surveyed poses."""
    images = [model.images[key] for key in sorted(model.reg_image_ids())]
    wanted = poses(surveyed[Path(image.name).name] for image in images)
    scale, turn, shift = fit_cameras(poses(images), wanted)
    model.transform(pycolmap.Sim3d(scale, pycolmap.Rotation3d(turn), shift))
    for image, pose in zip(images, wanted):
        model.frames[image.frame_id].rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(pose[:, :3]), pose[:, 3])


def adjust(model, loss: float, free_poses: bool, free_lens: bool) -> None:
    """Adjust the points, and what else is free."""
    options, config = pycolmap.BundleAdjustmentOptions(), pycolmap.BundleAdjustmentConfig()
    options.print_summary, options.min_track_length = False, 2
    options.refine_principal_point = free_lens
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = loss
    options.ceres.solver_options.function_tolerance = 1e-9
    options.ceres.solver_options.max_num_iterations = 60
    options.ceres.solver_options.num_threads = 1
    for key in model.reg_image_ids():
        config.add_image(key)
        if not free_poses:
            config.set_constant_rig_from_world_pose(model.images[key].frame_id)
    if not free_lens:
        config.set_constant_cam_intrinsics(next(iter(model.cameras)))
    if free_poses:
        config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_ceres_bundle_adjuster(options, config, model).solve()


def errors(model) -> np.ndarray:
    """Distances of all observations from where their points should be, pixels."""
    camera, found = next(iter(model.cameras.values())), []
    for key in model.reg_image_ids():
        image = model.images[key]
        spots = [spot for spot in image.points2D if spot.has_point3D()]
        places = np.array([model.points3D[spot.point3D_id].xyz for spot in spots])
        pose = image.cam_from_world().matrix()
        seen = np.asarray(camera.img_from_cam(places @ pose[:, :3].T + pose[:, 3]))
        found.append(np.linalg.norm(seen - [spot.xy for spot in spots], axis=1))
    return np.concatenate(found)


start = fresh()
adjust(start, 0.2, True, False)
middle = float(np.median(errors(start)))
loss, noise = ROBUST * middle, middle / MEDIAN
sys.stdout.write(f"noise {noise:.3f} px\n")
for name, free_poses, free_lens in (
    ("poses and lens of the survey", False, False),
    ("poses of the survey", False, True),
    ("lens of the survey", True, False),
    ("neither", True, True),
):
    model = fresh()
    if not free_poses:
        take_poses(model)
    adjust(model, loss, free_poses, free_lens)
    off = errors(model)
    cost = loss**2 * np.log1p((off / loss) ** 2).sum() / noise**2
    params = ", ".join(f"{value:.2f}" for value in next(iter(model.cameras.values())).params)
    told = f"median {np.median(off):.4f} px, robust chi-square {cost:.0f} of {2 * len(off)} residuals; lens {params}"
    sys.stdout.write(f"{name}: {told}\n")
    if (free_poses, free_lens) == (True, True) and "--jackknife" in sys.argv:
        without = []
        for key in sorted(model.reg_image_ids()):
            model = fresh()
            model.deregister_frame(model.images[key].frame_id)
            adjust(model, loss, True, True)
            without.append(next(iter(model.cameras.values())).params)
        spread = np.sqrt((len(without) - 1) * np.var(without, axis=0))
        sys.stdout.write(f"standard deviations of the lens by leaving out a photo: {np.round(spread, 2)}\n")
