"""The tour of photos in a real browser: frusta that are touched, flights, photos over the view, differences."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from chromium import Chromium, find_chromium
from page_assets import make_asset

import ibrpipe
from ibrpipe.export.page.exporter import write
from ibrpipe.io.assets import write_asset
from ibrpipe.io.views import View, ViewSet, write_views

pytestmark = pytest.mark.skipif(find_chromium() is None, reason="there is no Chromium; install the package chromium")

SIZE = (700, 420)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("profile")) as started:
        started.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
        yield started


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of a small asset with two held-out photos: its own renders, so that errors are those of coding alone."""
    folder = tmp_path_factory.mktemp("toured") / "run"
    asset = make_asset("matt")
    write_asset(asset, folder / "asset")
    views = []
    for n, eye in enumerate([(0.2, 0, 4), (1.5, 0.3, 3.5), (-1.2, 0.8, 3.6)]):
        camera = ibrpipe.Camera.look_at(eye, (0, 0, 0), (0.1 * n, 1, 0), 45, 160, 120)
        path = folder / f"photo{n}.png"
        ibrpipe.render(asset, camera, outputs=("color",), samples=4).save(path)
        views.append(View(f"photo{n}", camera, path, held_out=n > 0))
    (folder / "ingest").mkdir()
    write_views(ViewSet((views[0],), tuple(views[1:])), folder / "ingest/views.json")
    (folder / "report").mkdir()
    scored = {"name": "photo1", "renderers": {"ldi": {"psnr": 31.54}}, "mask_pixels": 3}
    (folder / "report/metrics.json").write_text(json.dumps({"renderer": "ldi", "views": [scored], "seconds": {}}))
    return folder


def wait_for(browser: Chromium, condition: str) -> None:
    look = f"const look = () => {condition} ? done() : setTimeout(look, 50);"
    browser.evaluate(f"new Promise(done => {{ {look} look(); }})")


def text_of(browser: Chromium, name: str) -> str:
    return browser.evaluate(f"document.getElementById('{name}').textContent")


def press(browser: Chromium, name: str) -> None:
    browser.evaluate(f"document.getElementById('{name}').click()")


def overlay_of(browser: Chromium) -> np.ndarray:
    text = browser.evaluate(
        "(() => { const o = document.getElementById('overlay');"
        "return [...o.getContext('2d').getImageData(0, 0, o.width, o.height).data].join(' '); })()"
    )
    return np.array(text.split(), np.uint8).reshape(120, 160, 4)


def test_held_out_photos_are_compared(browser: Chromium, run: Path, tmp_path: Path) -> None:
    told = write(run, tmp_path / "a.html")
    assert "with held-out photos to compare: 2 photos, 160 x 120 pixels" in told
    browser.errors.clear()
    browser.open((tmp_path / "a.html").as_uri(), *SIZE)
    assert browser.evaluate("document.getElementById('photo').hidden")
    press(browser, "compare-photos")
    wait_for(browser, "document.getElementById('error').textContent")
    assert text_of(browser, "photo-name") == "photo1"
    assert text_of(browser, "photo-number") == "1 of 2, held out"
    report, here = text_of(browser, "error").split("; ")
    assert report == "31.5 dB in the report"
    assert here.endswith("dB here, 160 × 120 pixels")
    # the photo is the renderer's own picture, four rays a pixel, too: what differs are 8 bits and WebP
    assert float(here.split()[0]) > 35
    photo = overlay_of(browser)
    browser.evaluate("document.querySelector('[data-show=difference]').click()")
    difference = overlay_of(browser)
    assert photo[..., :3].mean() > 60
    assert np.median(difference[..., :3]) < 40
    press(browser, "next")
    wait_for(browser, "document.getElementById('photo-name').textContent == 'photo2'")
    wait_for(browser, "document.getElementById('error').textContent")
    assert text_of(browser, "error").startswith("3")
    assert "report" not in text_of(browser, "error")
    press(browser, "leave")
    assert browser.evaluate("document.getElementById('photo').hidden")
    assert browser.errors == []


def test_the_view_lies_below_the_photo(browser: Chromium, run: Path, tmp_path: Path) -> None:
    from PIL import Image

    write(run, tmp_path / "a.html")
    browser.open((tmp_path / "a.html").as_uri(), *SIZE)
    press(browser, "compare-photos")
    wait_for(browser, "!document.getElementById('overlay').hidden")
    left, top, width, height = browser.evaluate(
        "(() => { const r = document.getElementById('overlay').getBoundingClientRect();"
        "return [r.left, r.top, r.width, r.height]; })()"
    )
    assert width / height == pytest.approx(4 / 3, rel=0.01)
    pictures = []
    for opacity in (100, 0):
        browser.evaluate(
            f"(() => {{ const o = document.getElementById('opacity'); o.value = {opacity};"
            "o.dispatchEvent(new Event('input')); })()"
        )
        browser.evaluate("new Promise(done => setTimeout(done, 1200))")
        browser.screenshot(tmp_path / "a.png")
        box = (round(left) + 2, round(top) + 2, round(left + width) - 2, round(top + height) - 2)
        pictures.append(np.asarray(Image.open(tmp_path / "a.png").convert("RGB").crop(box)).astype(int))
    # a shift by one pixel of the window would be a mean difference of several codes at the ball's rim and waves
    covered = pictures[0].sum(axis=-1) > 30
    assert covered.mean() > 0.3
    assert np.median(abs(pictures[0] - pictures[1]).max(axis=-1)[covered]) <= 8


def test_frusta_are_touched_and_lead_to_their_photos(browser: Chromium, tiny_ball: Path, tmp_path: Path) -> None:
    write(tiny_ball, tmp_path / "a.html")
    browser.errors.clear()
    browser.requests.clear()
    browser.open((tmp_path / "a.html").as_uri(), *SIZE)
    wait_for(browser, "document.body.className == 'ready'")
    browser.evaluate("new Promise(done => setTimeout(done, 500))")
    found = next(
        (x, y)
        for y in range(60, 320, 16)
        for x in range(150, 560, 16)
        if touched(browser, x, y)
    )  # fmt: skip
    name = text_of(browser, "label")
    for kind in ("mousePressed", "mouseReleased"):
        browser.call("Input.dispatchMouseEvent", type=kind, x=found[0], y=found[1], button="left", clickCount=1)
    wait_for(browser, "!document.getElementById('overlay').hidden")
    assert text_of(browser, "photo-name") == name
    assert browser.evaluate("document.getElementById('compare').hidden")
    browser.drag((300, 80), (380, 80))
    wait_for(browser, "document.getElementById('photo').hidden")
    browser.evaluate("document.getElementById('view').focus()")
    for kind in ("keyDown", "keyUp"):
        browser.call("Input.dispatchKeyEvent", type=kind, key="]")
    wait_for(browser, "!document.getElementById('photo').hidden")
    assert text_of(browser, "photo-number") == "1 of 17"
    assert browser.errors == []
    assert [each for each in browser.requests if not each.startswith(("file:", "data:", "blob:"))] == []


def touched(browser: Chromium, x: int, y: int) -> bool:
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    return not browser.evaluate("document.getElementById('label').hidden")


def test_meshes_of_captures_are_where_their_cameras_see_them(
    browser: Chromium, tiny_ball: Path, tmp_path: Path
) -> None:
    write(tiny_ball, tmp_path / "a.html")
    browser.open((tmp_path / "a.html").as_uri(), *SIZE)
    for view in ibrpipe.read_capture(tiny_ball).test:
        rays, eye = view.camera.pixel_rays(), view.camera.center
        along = (rays @ eye) / np.linalg.norm(rays, axis=-1)
        wanted = along**2 > eye @ eye - 1  # the rays that meet the unit ball
        shown = browser.render(view.camera, show={"mesh": True, "points": False, "photos": False})[..., 3] > 0
        # a mesh of flat triangles is smaller than the ball by less than a pixel along its outline
        assert (shown != wanted).mean() < 0.02
        assert wanted.mean() > 0.05
