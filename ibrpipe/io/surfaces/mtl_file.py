"""MTL files: colours and maps of OBJ materials, with blanks, backslashes and options as programs write them."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ibrpipe.errors import FormatError, MissingFileError
from ibrpipe.io.cameras.shots import PhotoFolder
from ibrpipe.io.untrusted.inside import leads_inside

#: Options before the name of a map, and how many words at most follow them; fewer where they are no numbers
_OPTIONS = {
    "-blendu": 1,
    "-blendv": 1,
    "-bm": 1,
    "-boost": 1,
    "-cc": 1,
    "-clamp": 1,
    "-imfchan": 1,
    "-mm": 2,
    "-o": 3,
    "-s": 3,
    "-t": 3,
    "-texres": 1,
    "-type": 1,
    "-colorspace": 1,
}
#: Options that change a map's values, and what they are when they do not
_NEUTRAL = {"-mm": [0.0, 1.0], "-bm": [1.0]}
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Map:
    """A texture as a material names it: its file, and factors and offsets of texture coordinates."""

    file: Path
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)


@dataclass
class Material:
    """A material: the lines that are no maps, and its maps by their key in lower case."""

    name: str
    lines: list[str] = field(default_factory=list)
    maps: dict[str, Map] = field(default_factory=dict)


def read_mtl(obj: Path, named: Sequence[str], strict: bool = True) -> dict[str, Material]:
    """Read the material files that an OBJ names.

    Parameters
    ----------
    obj : Path
    named : sequence of str
        What follows mtllib: a name, blanks and all, or several names.
    strict : bool
        What is named must exist; otherwise it is left out.

    Raises
    ------
    MissingFileError
        A material file, or a map of it that is used here, does not exist.
    """
    files = PhotoFolder(obj.parent, closed=True)
    found: dict[str, Material] = {}
    for words in named:
        whole = _file(files, words, obj)
        each: list[Path | None] = [whole]
        if whole is None:
            each = [_find(files, name, obj, "material file", "", strict) for name in words.split()]
        for path in each:
            found |= _materials(path, obj, strict) if path is not None else {}
    return found


def plain_mtl(materials: Mapping[str, Material]) -> bytes:
    """Return the text of materials with nothing but colours and the file of the colour map."""
    lines = []
    for material in materials.values():
        lines += [f"newmtl {material.name}", *material.lines]
        if "map_kd" in material.maps:
            lines.append(f"map_Kd {material.maps['map_kd'].file.resolve()}")
    return "\n".join(lines).encode("utf-8")


def _materials(path: Path, obj: Path, strict: bool) -> dict[str, Material]:
    stored, files = path.read_bytes(), PhotoFolder(path.parent, closed=True)
    try:
        text = stored.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = stored.decode("latin-1")
    found: dict[str, Material] = {}
    current: Material | None = None
    for line in text.replace("\\\r\n", " ").replace("\\\n", " ").splitlines():
        key, _, rest = line.strip().partition(" ")
        key, rest = (key.partition("\t")[0], key.partition("\t")[2] + " " + rest) if "\t" in key else (key, rest)
        if not rest.strip() or key.startswith("#"):
            continue
        if key.lower() == "newmtl":
            current = found.setdefault(" ".join(rest.split()), Material(" ".join(rest.split())))
        elif current is not None and _is_map(key):
            found_map = _map(rest.strip(), files, (path, obj), key, strict)
            current.maps |= {} if found_map is None else {key.lower(): found_map}
        elif current is not None:
            current.lines.append(f"{key} {rest.strip()}")
    return found


def _is_map(key: str) -> bool:
    return key.lower() in ("map_kd", "norm", "map_kn", "disp", "map_disp", "map_bump", "bump")


def _map(text: str, files: PhotoFolder, source: tuple[Path, Path], key: str, strict: bool) -> Map | None:
    """Read options and the name of a map; the name is the rest, blanks and all."""
    words, numbers = text.split(" "), {"-s": [1.0, 1.0], "-o": [0.0, 0.0], **{key: [*v] for key, v in _NEUTRAL.items()}}
    at = 0
    while at < len(words) and words[at].lower() in _OPTIONS:
        option, at = words[at].lower(), at + 1
        for place in range(_OPTIONS[option]):
            value = _number(words[at]) if at < len(words) else None
            if value is None and (place or _OPTIONS[option] > 1):
                break
            if option in numbers and place < len(numbers[option]) and value is not None:
                numbers[option][place] = value
            at += 1
    name = " ".join(words[at:]).strip().strip('"')
    if not name:
        raise FormatError(f"{source[0]}: {key} names no file ({text}); correct the line")
    scale, offset = numbers["-s"], numbers["-o"]
    _tell_unused(f"{source[0]}: {key} {name}", numbers)
    file = _find(files, name, source[1], "map", f" ({key} in {source[0].name})", strict)
    return None if file is None else Map(file, (scale[0], scale[1]), (offset[0], offset[1]))


def _tell_unused(where: str, numbers: Mapping[str, list[float]]) -> None:
    """Tell of options that would change the values of a map, which are left as the file has them."""
    for option, neutral in _NEUTRAL.items():
        if numbers[option] != neutral:
            given = " ".join(f"{value:g}" for value in numbers[option])
            _log.warning(
                "%s: %s %s is not applied, values stay as they are: apply it to the picture", where, option, given
            )


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None


def _file(files: PhotoFolder, name: str, source: Path) -> Path | None:
    """Return a file by its name, whatever its case and slashes, in the folder that names it or below."""
    found = files.at(name, source)
    if found is not None:
        return found
    wanted = name.replace("\\", "/").rpartition("/")[2].casefold()
    beside = (each for each in sorted(files.root.iterdir()) if each.name.casefold() == wanted)
    return next((each for each in beside if leads_inside(files.root, each)), None)


def _find(files: PhotoFolder, name: str, source: Path, what: str, where: str, strict: bool) -> Path | None:
    found = _file(files, name, source)
    if found is None and strict:
        raise MissingFileError(
            f"{files.root / name}: the {what} that {source.name} names does not exist{where}; put it there, "
            "or remove the line"
        )
    return found
