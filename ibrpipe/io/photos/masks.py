"""Which mask belongs to a photo: the conventions of COLMAP, same-stem folders, OpenMVS and alpha, or any that pairs."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ibrpipe.io.cameras.shots import PHOTO_SUFFIXES
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


@dataclass(frozen=True)
class MaskedPhoto:
    """What finding a photo's mask needs to know; as `find_mask` takes it."""

    file: str
    image: Path
    named: Path | None = None
    has_alpha: bool = False


def find_masks(capture: Path, photos: Sequence[MaskedPhoto]) -> tuple[list[MaskChoice], list[str], list[str]]:
    """Find the masks of all photos of a folder: by the conventions of `find_mask`, else any naming that pairs them.

    Returns
    -------
    choices : list of MaskChoice
        In the order of the photos.
    notes, warnings : list of str
        Which other naming was understood; which files of ``masks/`` belong to no photo.
    """
    chosen = [find_mask(capture, each.file, each.image, each.named, each.has_alpha) for each in photos]
    used = {choice.file for choice in chosen}
    files = [file for file in _mask_files(capture) if file not in used]
    open_ones = [index for index, choice in enumerate(chosen) if choice.file is None]
    if not files:
        return chosen, [], []
    names = {_stem(photos[index].file): index for index in reversed(open_ones)}
    pairs = _paired(list(names), {_mask_stem(file, capture): file for file in files})
    for name, file in pairs.items():
        chosen[names[name]] = MaskChoice(file)
    notes, warnings = [], []
    if pairs:
        name, file = next(iter(sorted(pairs.items())))
        text = f"{len(pairs)} masks are paired with photos by their names, such as {_below(file, capture)}"
        notes.append(f"{text} with {photos[names[name]].file}")
    left = sorted(set(files) - set(pairs.values()) - _of_other_photos(capture, files))
    if left:
        warnings.append(
            f"{len(left)} of {len(files) + len(used - {None})} masks belong to no photo, the first is "
            f"{_below(left[0], capture)}: call masks as their photos, masks/a.png for a.jpg"
        )
    return chosen, notes, warnings


def _mask_files(capture: Path) -> list[Path]:
    """Images in the folder of masks, whatever the case of its name."""
    if not capture.is_dir():
        return []
    folders = [path for path in capture.iterdir() if path.name.lower() in ("masks", "mask") and path.is_dir()]
    found = (path for folder in folders for path in folder.rglob("*"))
    return sorted(path for path in found if path.suffix.lower() in PHOTO_SUFFIXES and not path.name.startswith("."))


def _of_other_photos(capture: Path, files: Sequence[Path]) -> set[Path]:
    """Masks of photos in images/ that have no camera: those are told of already."""
    photos = (path.relative_to(capture / "images") for path in (capture / "images").rglob("*"))
    stems = [_stem(path.as_posix()) for path in photos]
    return set(_paired(stems, {_mask_stem(file, capture): file for file in files}).values())


def _below(file: Path, capture: Path) -> str:
    return file.relative_to(capture).as_posix()


def _stem(file: str) -> str:
    return Path(file).with_suffix("").as_posix().casefold()


def _mask_stem(file: Path, capture: Path) -> str:
    """Return a mask's path below its folder without suffixes, that of the photo (a.jpg.png) among them."""
    path = Path(*file.relative_to(capture).parts[1:]).with_suffix("")
    return (path.with_suffix("") if path.suffix.lower() in PHOTO_SUFFIXES else path).as_posix().casefold()


def _paired(photos: Sequence[str], masks: Mapping[str, Path]) -> dict[str, Path]:
    """Pair stems one to one: equal ones, equal file names, the same piece of text more, equal numbers."""
    pairs: dict[str, Path] = {}
    for match in (_by_path, _by_name, _by_affix, _by_shorter, _by_number):
        taken = set(pairs.values())
        free = {stem: file for stem, file in masks.items() if file not in taken}
        pairs |= match([stem for stem in photos if stem not in pairs], free)
    return pairs


def _by_path(photos: Sequence[str], masks: Mapping[str, Path]) -> dict[str, Path]:
    return {stem: masks[stem] for stem in photos if stem in masks}


def _by_name(photos: Sequence[str], masks: Mapping[str, Path]) -> dict[str, Path]:
    names, files = _unique(photos, _name), _unique(list(masks), _name)
    return {names[name]: masks[files[name]] for name in names if name in files}


def _by_affix(photos: Sequence[str], masks: Mapping[str, Path]) -> dict[str, Path]:
    """Pair file names that differ by the same text before and behind: a and a_mask, b and b_mask."""
    names, files = _unique(photos, _name), _unique(list(masks), _name)
    affixes: Counter[tuple[str, str]] = Counter()
    for name in names:
        for other in files:
            at = other.find(name)
            if at >= 0:
                affixes[other[:at], other[at + len(name) :]] += 1
    best = max(affixes, key=lambda affix: (affixes[affix], -len("".join(affix))), default=None)
    if best is None or affixes[best] < min(0.8 * len(files), len(names)):
        return {}
    found = {name: f"{best[0]}{name}{best[1]}" for name in names}
    return {names[name]: masks[files[other]] for name, other in found.items() if other in files}


def _by_shorter(photos: Sequence[str], masks: Mapping[str, Path]) -> dict[str, Path]:
    """Pair as `_by_affix`, where it is the photos' names that are longer: IMG_a and a."""
    turned = _by_affix(list(masks), {stem: Path(stem) for stem in photos})
    return {photo.as_posix(): masks[mask] for mask, photo in turned.items()}


def _by_number(photos: Sequence[str], masks: Mapping[str, Path]) -> dict[str, Path]:
    """Pair by the last number in the file names; all masks or none."""
    names, files = _unique(photos, _number), _unique(list(masks), _number)
    found = {names[number]: masks[files[number]] for number in names if number in files}
    return found if len(found) == len(masks) > 1 else {}


def _name(stem: str) -> str:
    return stem.rsplit("/", 1)[-1]


def _number(stem: str) -> str:
    found = re.findall(r"\d+", _name(stem))
    return str(int(found[-1])) if found else ""


def _unique(stems: Sequence[str], key: Callable[[str], str]) -> dict[str, str]:
    """Stems by their key, where no other has the same; stems without a key are left out."""
    counts = Counter(key(stem) for stem in stems)
    return {key(stem): stem for stem in stems if key(stem) and counts[key(stem)] == 1}
