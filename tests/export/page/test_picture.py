"""Pages in a real browser against the `ldi` renderer, and what a user does there."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from chromium import Chromium, find_chromium
from page_assets import make_asset

import ibrpipe
from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.export.page.exporter import write
from ibrpipe.io.assets import write_asset

pytestmark = pytest.mark.skipif(find_chromium() is None, reason="there is no Chromium; install the package chromium")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("profile")) as started:
        yield started


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory):
    """Return a function from a kind of asset to its page and the asset as a page's reader has it."""
    made: dict[str, tuple[str, ibrpipe.Asset]] = {}
    folder = tmp_path_factory.mktemp("pages")

    def make(kind: str) -> tuple[str, ibrpipe.Asset]:
        if kind not in made:
            write_asset(make_asset(kind), folder / kind)
            write(folder / kind, folder / f"{kind}.html")
            made[kind] = (folder / f"{kind}.html").as_uri(), ibrpipe.read_asset(folder / kind)
        return made[kind]

    return make


def cameras() -> list[ibrpipe.Camera]:
    eyes = [(0, 0, 4), (1.5, 0.3, 3.5), (2.6, 1, 1.8), (-2, -1.2, 2.4), (0.4, 2.2, 2.6), (0.5, -0.4, -5), 
            (3.4, 0.4, 0.7), (-2.4, 2, -3.1)]  # fmt: skip
    return [ibrpipe.Camera.look_at(eye, (0, 0, 0), (0, 1, 0), 45, 200, 150) for eye in eyes]


@pytest.mark.parametrize("kind", ["matt", "perspective", "spiral", "gloss", "mirror", "photos"])
def test_it_shows_what_ldi_renders(browser: Chromium, page, kind: str) -> None:
    address, asset = page(kind)
    browser.errors.clear()
    browser.requests.clear()
    browser.open(address, 320, 240)
    found, prepared = [], ibrpipe.prepare(asset, "ldi")
    for camera in cameras():
        got, want = browser.render(camera), ibrpipe.render(prepared, camera, outputs=("color", "alpha"))
        covered, shown = want.alpha > 0, got[..., 3] > 0
        assert covered.mean() > 0.005
        assert (covered != shown).mean() <= 0.001
        error = got[..., :3].astype(float) - to_bytes(srgb_encode(want.color))
        found.append(10 * np.log10(255**2 / max((error[covered & shown] ** 2).mean(), 1e-3)))
    # browsers turn AVIF's luma and chroma into whole codes on their own, up to a code beside what Pillow does
    mean, least = (45, 43) if kind == "photos" else (50, 45)
    assert np.mean(found) >= mean, found
    assert min(found) >= least, found
    assert browser.errors == []
    assert [each for each in browser.requests if not each.startswith(("file:", "data:", "blob:"))] == []


def test_view_dependence_can_be_switched_off(browser: Chromium, page) -> None:
    address, asset = page("spiral")
    browser.open(address, 320, 240)
    camera = cameras()[1]
    plain = ibrpipe.render(asset, camera, outputs=("color", "alpha"), residuals=False)
    got = browser.render(camera, dependent=False)
    assert (
        abs(got[..., :3][plain.alpha > 0].astype(int) - to_bytes(srgb_encode(plain.color))[plain.alpha > 0]).mean()
        < 0.5
    )
    assert abs(browser.render(camera)[..., :3].astype(int) - got[..., :3]).max() > 20
    assert browser.evaluate("document.getElementById('dependent').getAttribute('aria-pressed')") == "true"
    browser.evaluate("document.getElementById('dependent').click()")
    assert browser.evaluate("document.getElementById('dependent').getAttribute('aria-pressed')") == "false"


def test_dragging_turns_it(browser: Chromium, page, tmp_path: Path) -> None:
    from PIL import Image

    browser.errors.clear()
    browser.open(page("matt")[0], 400, 300)
    pictures = []
    for n in range(3):
        browser.evaluate("new Promise(done => setTimeout(done, 900))")
        browser.screenshot(tmp_path / f"{n}.png")
        pictures.append(np.asarray(Image.open(tmp_path / f"{n}.png").convert("RGB")).astype(int))
        if n == 0:
            browser.drag((200, 150), (260, 150))
        else:
            browser.evaluate("document.getElementById('home').click()")
    assert np.ptp(pictures[0][80:220, 120:280]) > 100
    assert abs(pictures[1] - pictures[0]).mean() > 2
    assert abs(pictures[2] - pictures[0]).mean() < 0.5
    assert browser.errors == []
    assert not browser.evaluate("document.getElementById('scale').hidden")


def test_without_webgl2_a_picture_and_a_line_stay(page, tmp_path: Path) -> None:
    with Chromium(tmp_path / "profile", "--disable-3d-apis") as plain:
        plain.open(page("matt")[0], 320, 240)
        assert "lacks WebGL2" in plain.evaluate("document.getElementById('message').textContent")
        assert plain.evaluate("document.getElementById('poster').naturalWidth") == 720
        assert plain.evaluate("getComputedStyle(document.getElementById('poster')).display") != "none"


def test_nothing_behind_it_shows_through_on_the_screen(browser: Chromium, page, tmp_path: Path) -> None:
    """Every patch decides on its pixels by one ray: where the browser shares them out by area, borders let light in."""
    from PIL import Image
    from scipy.ndimage import binary_fill_holes

    shown = []
    for scheme in ("light", "dark"):
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        browser.open(page("matt")[0], 500, 400)
        browser.evaluate("new Promise(done => setTimeout(done, 1500))")  # at rest
        browser.screenshot(tmp_path / f"{scheme}.png")
        shown.append(np.asarray(Image.open(tmp_path / f"{scheme}.png").convert("RGB"))[60:340].astype(int))
    browser.call("Emulation.setEmulatedMedia", features=[])
    same = (np.abs(shown[0] - shown[1]) <= 1).all(axis=2)
    assert same.mean() > 0.05
    assert not (binary_fill_holes(same) & ~same).any()
