"""An asset or a capture as one web page that needs nothing beside itself."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.errors import FormatError
from ibrpipe.export.asset_folders import found_asset, name_of, units_of
from ibrpipe.export.page.capture_page import make_capture_page
from ibrpipe.export.page.capture_scene import read_capture_scene
from ibrpipe.export.page.components import KINDS
from ibrpipe.export.page.document import Page, page_text
from ibrpipe.export.page.measured import measured_psnr
from ibrpipe.export.page.notes import PageNotes, read_notes
from ibrpipe.export.page.packing import Packer
from ibrpipe.export.page.photos import Picture, load_pictures, pack_photos, told_size, webp
from ibrpipe.export.page.surface import pack_surface
from ibrpipe.export.page.view import Start, find_start
from ibrpipe.export.registry import Exporter
from ibrpipe.export.whole_file import check_file, megabytes, write_files
from ibrpipe.io.assets import read_asset
from ibrpipe.io.views import read_views, spread, views_in_run
from ibrpipe.renderers.api import render
from ibrpipe.types import Array, Asset
from ibrpipe.types.bounds import sample_positions

logger = logging.getLogger(__name__)

#: bytes of a page above which a word is said
LARGE = 32 << 20
#: what makes it smaller
SMALLER = "a lower plan.oversampling or compress.target_mb"
#: width and height of the poster, pixels
POSTER = (720, 540)
#: pixels of all held-out photos of a page together: about 2 MB
HELD_OUT_PIXELS = 8_000_000


def write(source: Path, target: Path, notes: Path | None = None) -> str:
    """Write what there is to see of `source` as the page `target`; return what was written. See ``docs/viewer.md``.

    Parameters
    ----------
    source : Path
        An asset, a run, or a capture.
    notes : Path, optional
        YAML file with title, credit, licence, annotations and saved views.

    Raises
    ------
    MissingFileError, FormatError, ConfigError, CaptureError
        What is to be shown is missing, damaged, or holds what a page cannot show.
    ResourceError
        The page cannot be written.
    """
    check_file(target)
    page = page_of(source, notes)
    content = page.text.encode("utf-8")
    write_files(target.parent, {target.name: content})
    if len(content) > LARGE:
        logger.warning(f"{target} takes {megabytes(len(content))}, which phones may refuse: {SMALLER} makes it smaller")
    return ", ".join(filter(None, (megabytes(len(content)), page.told)))


def page_of(source: Path, notes: Path | None = None, allow_outside: bool = False) -> Page:
    """Return the page of an asset or of a run's asset; without one, of a capture or of a run so far.

    A capture's files may lie outside its folder where that is allowed. Raises as `write` does of what it reads.
    """
    words = PageNotes() if notes is None else read_notes(notes)
    asset = found_asset(source)
    if asset is None:
        return make_capture_page(read_capture_scene(source, allow_outside), words)
    views = views_in_run(asset.parent)
    measured = None if views is None else measured_psnr(asset.parent)
    return make_page(read_asset(asset), words, name_of(asset), views, measured)


def make_page(
    asset: Asset,
    notes: PageNotes,
    name: str,
    views: Path | None = None,
    measured: Mapping[str, float] | None = None,
    turning: bool = False,
) -> Page:
    """Return an asset as a page.

    Parameters
    ----------
    notes : PageNotes
    name : str
        Its title where `notes` has none.
    views : Path, optional
        ``views.json``, whose cameras say what is up and where the first view is; its held-out photos are shown.
    measured : mapping of name to float, optional
        PSNR of held-out photos, dB, as the run's report states it.
    turning : bool
        It turns by itself from the start, where the system does not ask for less motion.

    Raises
    ------
    FormatError
        The asset is empty, or holds what a page cannot show.
    """
    if not sum(len(texture.layers.depth) for texture in asset.textures):
        raise FormatError(f"{name}: the asset holds no sample; nothing can be shown")
    notes = notes.model_copy(update={"title": notes.title or name})
    packer = Packer()
    surfaces = [pack_surface(texture.layers, packer) for texture in asset.textures]
    known = [kind for kind in asset.kinds if kind in KINDS]
    for kind in sorted(set(asset.kinds) - set(known)):
        logger.warning(f'view dependence of kind "{kind}" is left out: pages know {", ".join(KINDS)}')
    components = {kind: KINDS[kind](asset, packer) for kind in known}
    places = np.concatenate([sample_positions(each.layers) for each in asset.textures])
    start = find_start(asset, places, views, notes)
    pictures = _held_out(views, notes.photos)
    photos = pack_photos(pictures, packer, measured or {})
    meta = {
        "surfaces": surfaces,
        "components": components,
        "photos": photos,
        "start": {"up": start.up.tolist(), "from": start.toward.tolist(), "turning": turning},
        "units": notes.units or units_of(asset),
        "notes": [each.model_dump() for each in notes.annotations],
        "views": [each.model_dump() for each in notes.views],
    }
    text = page_text(notes, meta, packer.encoded(), poster(asset, start))
    return Page(text, f"with held-out photos to compare: {told_size(pictures, photos)}" if photos else "")


def poster(asset: Asset, start: Start) -> bytes:
    """Return the first view as a WebP picture with a clear background."""
    frame = render(asset, start.camera(*POSTER), outputs=("color", "alpha"))
    rgba = np.concatenate([srgb_encode(_array(frame.color)), _array(frame.alpha)[..., None]], axis=-1)
    return webp(to_bytes(rgba))


def _held_out(views: Path | None, most: int) -> list[Picture]:
    """Pictures of held-out photos, evenly chosen."""
    chosen = () if views is None else spread(read_views(views).test, most) if most else ()
    return load_pictures(chosen, HELD_OUT_PIXELS)


def _array(part: Array | None) -> Array:
    assert part is not None
    return part


EXPORTER = Exporter(
    "page", "One web page that shows an asset or a capture from all sides.", write, (".html", ".htm"), takes="any",
    takes_notes=True,
)  # fmt: skip
