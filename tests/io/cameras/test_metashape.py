"""Cameras of Metashape: sensors, rigs, components and chunks."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from camera_files import names, told
from scipy.spatial.transform import Rotation

from ibrpipe.errors import CaptureError, MissingFileError
from ibrpipe.io.captures import read_capture

F = 125.5


def metashape(capture: Path, sensors: str = "", components: str = "", **of_camera: dict[str, str]) -> list[np.ndarray]:
    """Write cameras.xml in place of COLMAP's; return the matrices world-from-camera."""
    views = sorted((lambda c: c.train + c.test)(read_capture(capture)), key=lambda view: view.name)
    shutil.rmtree(capture / "sparse", ignore_errors=True)
    matrices, cameras = [], []
    for index, view in enumerate(views):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = view.camera.R.T, view.camera.center
        matrices.append(matrix)
        stated = {
            "id": str(index),
            "sensor_id": "0",
            "label": view.name,
            "matrix": matrix,
            **of_camera.get(f"_{index}", {}),
        }
        matrix = stated.pop("matrix")
        numbers = "" if matrix is None else f"<transform>{' '.join(map(repr, matrix.ravel().tolist()))}</transform>"
        attributes = " ".join(f'{key}="{value}"' for key, value in stated.items())
        cameras.append(f"<camera {attributes}>{numbers}</camera>")
    (capture / "cameras.xml").write_text(
        f'<document version="2.0"><chunk><sensors>{sensors or sensor()}</sensors>{components}'
        f"<cameras>{''.join(cameras)}</cameras></chunk></document>"
    )
    return matrices


def sensor(number: int = 0, more: str = "", calibrations: str | None = None, label: str = "") -> str:
    calibrations = calibrations or f'<calibration class="adjusted"><f>{F}</f></calibration>'
    size = '<resolution width="96" height="72"/>'
    return f'<sensor id="{number}" label="{label}" type="frame">{size}{calibrations}{more}</sensor>'


@pytest.mark.parametrize("order", [1, -1])
def test_the_adjusted_calibration_is_taken(capture: Path, order: int) -> None:
    both = [
        '<calibration class="initial"><f>100</f></calibration>',
        f'<calibration class="adjusted"><f>{F}</f><cx>1.5</cx><cy>-0.5</cy></calibration>',
    ]
    metashape(capture, sensor(calibrations="".join(both[::order])))
    K = read_capture(capture).train[0].camera.K
    assert (K[0, 0], K[0, 2], K[1, 2]) == (F, 49.5, 35.5)


def test_cameras_of_a_rig_are_placed_by_their_master(capture: Path, tmp_path: Path) -> None:
    R, place = Rotation.from_euler("xyz", [5, -10, 20], degrees=True).as_matrix(), np.array([0.1, -0.2, 0.05])
    numbers = " ".join(map(repr, R.ravel().tolist()))
    offset = f"<rotation>{numbers}</rotation><location>{place[0]} {place[1]} {place[2]}</location>"
    slaves = {"_1": {"matrix": None, "master_id": "0", "sensor_id": "1"}, "_3": {"matrix": None, "master_id": "2"}}
    matrices = metashape(capture, sensor() + sensor(1, offset), **slaves)
    found = {view.name: view.camera for view in read_capture(capture).train + read_capture(capture).test}
    relative = np.eye(4)
    relative[:3, :3], relative[:3, 3] = R, place
    wanted = matrices[0] @ relative
    assert np.abs(found["001"].R.T - wanted[:3, :3]).max() < 1e-9
    assert np.abs(found["001"].center - wanted[:3, 3]).max() < 1e-9
    assert "003" not in found
    text = told(capture, tmp_path)
    assert "1 cameras of a rig are placed by their sensor's offset from the master" in text
    assert "1 of 14 cameras of a rig have a sensor without an offset from the master and are left out" in text
    assert "units" not in text
    scaled = "<transform><scale>0.5</scale></transform>"
    metashape(capture, sensor() + sensor(1, offset), scaled, **{"_1": slaves["_1"]})
    found = {view.name: view.camera for view in read_capture(capture).train + read_capture(capture).test}
    wanted = 0.5 * (matrices[0] @ relative)[:3, 3]
    assert np.abs(found["001"].center - wanted).max() < 1e-9
    assert "taken in the chunk's own units, of which one is 0.5 local units" in told(capture, tmp_path)


def test_cameras_that_are_not_aligned_or_switched_off_are_counted(capture: Path, tmp_path: Path) -> None:
    metashape(capture, _2={"matrix": None}, _5={"matrix": None}, _6={"enabled": "0"})
    text = told(capture, tmp_path)
    assert "2 of 14 cameras are not aligned and are left out, the first is 002" in text
    assert "1 of 14 cameras are switched off in Metashape and are left out, the first is 006" in text
    assert "3 of 14 photos" in text


def component(number: int, scale: float | None) -> str:
    place = "" if scale is None else f"<transform><scale>{scale}</scale></transform>"
    return f'<component id="{number}">{place}</component>'


def test_every_component_has_its_own_place(capture: Path) -> None:
    known = {f"_{n}": {"component_id": str(int(n >= 7))} for n in range(14)}
    parts = f'<components active_id="0">{component(0, 1)}{component(1, 2)}</components>'
    matrices = metashape(capture, components=parts, **known)
    found = read_capture(capture)
    centers = {view.name: view.camera.center for view in found.train + found.test}
    for n, matrix in enumerate(matrices):
        assert np.abs(centers[f"{n:03d}"] - matrix[:3, 3] * (2 if n >= 7 else 1)).max() < 1e-9


def test_components_without_a_place_are_left_out_and_told(capture: Path, tmp_path: Path) -> None:
    known = {f"_{n}": {"component_id": str(int(n >= 10))} for n in range(14)}
    metashape(capture, components=f"<components>{component(0, None)}{component(1, None)}</components>", **known)
    assert len(names(read_capture(capture))) == 10
    assert "4 of 14 cameras belong to a component whose place among the others is not known" in told(capture, tmp_path)


def in_two_folders(capture: Path) -> dict[str, dict[str, str]]:
    for n in range(14):
        folder = capture / "images" / ("right" if n % 2 else "left")
        folder.mkdir(exist_ok=True)
        (capture / f"images/{n:03d}.png").rename(folder / f"{n // 2:03d}.png")
    shutil.rmtree(capture / "masks")
    return {f"_{n}": {"label": f"{n // 2:03d}", "sensor_id": str(n % 2)} for n in range(14)}


def test_equal_labels_in_two_folders_are_told_apart_by_sensor_or_refused(capture: Path) -> None:
    read = read_capture(capture)
    places = {view.name: view.camera.center for view in read.train + read.test}
    labels = {f"_{n}": {"label": f"{n // 2:03d}", "sensor_id": str(n % 2)} for n in range(14)}
    metashape(capture, sensor(0, label="left") + sensor(1, label="right"), **labels)
    in_two_folders(capture)
    found = read_capture(capture)
    for view in found.train + found.test:
        side, number = view.name.split("__")
        assert np.abs(view.camera.center - places[f"{2 * int(number) + (side == 'right'):03d}"]).max() < 1e-9
    path = capture / "cameras.xml"
    path.write_text(path.read_text().replace('label="left"', 'label="X100"').replace('label="right"', 'label="X100"'))
    with pytest.raises(CaptureError, match=r"the photo 000 may be left/000.png or right/000.png; expected one file"):
        read_capture(capture)


def test_a_label_without_a_photo_is_told(capture: Path) -> None:
    metashape(capture, _4={"label": "lost"})
    with pytest.raises(MissingFileError, match="names the photo lost"):
        read_capture(capture)
    for number in (7, 9):
        (capture / f"images/{number:03d}.png").unlink()
    with pytest.raises(MissingFileError, match=r"names the photo lost, .*\(3 of 14 photos are missing\)"):
        read_capture(capture)


def test_of_several_chunks_that_of_most_aligned_cameras_is_read(capture: Path, tmp_path: Path) -> None:
    metashape(capture)
    path = capture / "cameras.xml"
    empty = '<chunk label="old"><cameras><camera id="0" label="000"/></cameras></chunk><chunk'
    path.write_text(path.read_text().replace("<chunk", empty, 1))
    assert len(names(read_capture(capture))) == 14
    assert "holds 2 chunks; only that of most aligned cameras" in told(capture, tmp_path)
