"""Which mask belongs to a photo: the conventions of COLMAP, same-stem folders, OpenMVS and alpha."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ibrpipe.io.views import MaskRule


@dataclass(frozen=True)
class MaskChoice:
    """A photo's mask: a file, the photo's alpha, or none; and how its values count."""

    file: Path | None = None
    from_alpha: bool = False
    rule: MaskRule = "coverage"


def find_mask(capture: Path, file: str, image: Path, named: Path | None, has_alpha: bool) -> MaskChoice:
    """Find a photo's mask; the first of these that exists.

    Parameters
    ----------
    capture : Path
        Folder that may hold ``masks/``.
    file : str
        The photo's name relative to ``images/``, posix.
    image : Path
    named : Path or None
        Mask that ``transforms.json`` names (``mask_path``).
    has_alpha : bool
        The photo has an alpha channel.

    Notes
    -----
    In order: the named one; ``masks/a.jpg.png`` (COLMAP: every value but zero counts); ``masks/a.png`` (coverage);
    ``masks/a.mask.png`` or ``a.mask.png`` beside the photo (OpenMVS: every label but zero counts); alpha (coverage).
    """
    if named is not None:
        return MaskChoice(named)
    masks, stem = capture / "masks", Path(file).with_suffix("").as_posix()
    candidates: list[tuple[Path, MaskRule]] = [
        (masks / f"{file}.png", "nonzero"),
        (masks / f"{stem}.png", "coverage"),
        (masks / f"{stem}.mask.png", "nonzero"),
        (image.with_name(f"{image.stem}.mask.png"), "nonzero"),
    ]
    for path, rule in candidates:
        if path.is_file() and path != image:
            return MaskChoice(path, rule=rule)
    return MaskChoice(from_alpha=has_alpha)
