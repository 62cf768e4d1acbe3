"""An asset as one web page that needs nothing beside itself."""

from __future__ import annotations

import io
import logging
from pathlib import Path

import numpy as np

from ibrpipe.core.color import srgb_encode, to_bytes
from ibrpipe.errors import FormatError
from ibrpipe.export.asset_folders import name_of
from ibrpipe.export.page.components import KINDS
from ibrpipe.export.page.document import page_text
from ibrpipe.export.page.notes import PageNotes, read_notes
from ibrpipe.export.page.packing import Packer
from ibrpipe.export.page.surface import pack_surface
from ibrpipe.export.page.view import Start, find_start
from ibrpipe.export.registry import Exporter
from ibrpipe.export.whole_file import check_file, write_files
from ibrpipe.io.assets import read_asset
from ibrpipe.io.views import IN_RUN
from ibrpipe.renderers.api import render
from ibrpipe.types import Array, Asset
from ibrpipe.types.bounds import sample_positions

logger = logging.getLogger(__name__)

#: bytes of a page above which a word is said
LARGE = 32 << 20
#: width and height of the poster, pixels
POSTER = (720, 540)
#: what assets say of their units when nobody knows them
UNKNOWN_UNITS = "scene units"


def write(source: Path, target: Path, notes: Path | None = None) -> None:
    """Write the asset in folder `source` as the page `target`; see ``docs/viewer.md``.

    Parameters
    ----------
    notes : Path, optional
        YAML file with title, credit, licence, annotations and saved views.

    Raises
    ------
    MissingFileError, FormatError, ConfigError
        The asset or the notes are missing, damaged, or hold what a page cannot show.
    ResourceError
        The page cannot be written.
    """
    check_file(target)
    text = page_of(source, notes)
    write_files(target.parent, {target.name: text.encode("utf-8")})
    if len(text) > LARGE:
        size = f"{len(text) / 1e6:.0f} MB"
        remedy = "lower plan.oversampling, raise compress.loss_db"
        logger.warning(f"{target} takes {size}, which phones may refuse: {remedy}")


def page_of(source: Path, notes: Path | None = None) -> str:
    """Return the page of the asset in folder `source`; raises as `write` does of what it reads."""
    words = PageNotes() if notes is None else read_notes(notes)
    views = source.parent / IN_RUN
    return make_page(read_asset(source), words, name_of(source), views if views.is_file() else None)


def make_page(asset: Asset, notes: PageNotes, name: str, views: Path | None = None) -> str:
    """Return an asset as the text of a page.

    Parameters
    ----------
    notes : PageNotes
    name : str
        Its title where `notes` has none.
    views : Path, optional
        ``views.json``, whose cameras say what is up and where the first view is.

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
    start = find_start(asset, places, views, None if notes.up is None else np.array(notes.up))
    meta = {
        "surfaces": surfaces,
        "components": components,
        "start": {"up": start.up.tolist(), "from": start.toward.tolist()},
        "units": notes.units or units_of(asset),
        "notes": [each.model_dump() for each in notes.annotations],
        "views": [each.model_dump() for each in notes.views],
    }
    return page_text(notes, meta, packer.encoded(), poster(asset, start))


def units_of(asset: Asset) -> str:
    """Return the name of the unit of length; empty where nobody knows it."""
    told = str(asset.info.get("units", ""))
    return "" if told.startswith(UNKNOWN_UNITS) else told


def poster(asset: Asset, start: Start) -> bytes:
    """Return the first view as a WebP picture with a clear background."""
    from PIL import Image

    frame = render(asset, start.camera(*POSTER), outputs=("color", "alpha"))
    rgba = np.concatenate([srgb_encode(_array(frame.color)), _array(frame.alpha)[..., None]], axis=-1)
    out = io.BytesIO()
    Image.fromarray(to_bytes(rgba), "RGBA").save(out, "WEBP", quality=82)
    return out.getvalue()


def _array(part: Array | None) -> Array:
    assert part is not None
    return part


EXPORTER = Exporter(
    "page", "One web page that shows the asset from all sides.", write, (".html", ".htm"), takes_notes=True
)
