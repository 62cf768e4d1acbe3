"""Child of `test_hostile_assets`: puts hostile numbers into an asset, one at a time, and reads and renders it.

``python hostile_child.py ASSET FIRST``: prints number, place and value of each case from FIRST on, then its outcome.
"""

import json
import signal
import sys
import zipfile
from pathlib import Path

import numpy as np

import ibrpipe
from ibrpipe.errors import IbrError

VALUES = (0, -1, 0.5, 1e-9, 3e38, 10**30, float("nan"), "x", [])
#: processor time of a case, s: what takes longer is ended by a signal
SECONDS = 30
EYES = ((0.6, 0.4, -2.0), (1.5, 0.5, -0.5))


def places(value, at=()):
    """Yield the path of every number; of lists the second, or the only one, and the last."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from places(each, (*at, key))
    elif isinstance(value, list):
        count = len(value)
        for index in sorted({min(1, count - 1), count - 1} & set(range(count))):
            yield from places(value[index], (*at, index))
    elif (isinstance(value, int | float) and not isinstance(value, bool)) or isinstance(value, bool):
        yield at


def changed(document, at, value):
    """Return a copy of a document with another value in one place."""
    copy = json.loads(json.dumps(document))
    target = copy
    for key in at[:-1]:
        target = target[key]
    target[at[-1]] = value
    return copy


def documents(folder):
    """Yield (file, name within or None, document) of every JSON text in an asset."""
    yield folder / "asset.json", None, json.loads((folder / "asset.json").read_text())
    for file in sorted(folder.rglob("*.zip")):
        with zipfile.ZipFile(file) as archive:
            for name in ("residuals.json", "layers.json"):
                if name in archive.namelist():
                    yield file, name, json.loads(archive.read(name))


def store(file, name, document):
    """Write a document back to where it was."""
    text = json.dumps(document)
    if name is None:
        file.write_text(text)
        return
    with zipfile.ZipFile(file) as archive:
        parts = {each: archive.read(each) for each in archive.namelist()}
    with zipfile.ZipFile(file, "w") as archive:
        for each, data in (parts | {name: text.encode()}).items():
            archive.writestr(each, data)


def outcome(folder):
    """Read and render an asset with all renderers; say how it ended."""
    try:
        asset = ibrpipe.read_asset(folder)
        told = []
        for renderer in ibrpipe.renderers():
            for eye in EYES:
                camera = ibrpipe.Camera.look_at(eye, (0.5, 0.4, 0.4), (0, 1, 0), 60, 16, 12)
                try:
                    frame = ibrpipe.render(asset, camera, renderer)
                except IbrError:
                    told.append(renderer)
                    break
                if not np.isfinite(frame.color).all():
                    return f"NaN of {renderer}"
    except IbrError as error:
        return "told" if "\n" not in str(error) else "told in several lines"
    except Exception as error:
        return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
    return "rendered"


def main(folder, first):
    """Go through all cases, once everything is compiled."""
    number = 0
    if outcome(folder) != "rendered":
        sys.exit("the asset cannot be rendered as it is")
    for file, name, document in list(documents(folder)):
        kept = file.read_bytes()
        for at in places(document):
            for value in VALUES:
                if number >= first:
                    sys.stdout.write(f"{number} {name or file.name} {'.'.join(map(str, at))} {value!r} -> ")
                    sys.stdout.flush()
                    store(file, name, changed(document, at, value))
                    signal.setitimer(signal.ITIMER_PROF, SECONDS)
                    sys.stdout.write(f"{outcome(folder)}\n")
                    sys.stdout.flush()
                    signal.setitimer(signal.ITIMER_PROF, 0)
                    file.write_bytes(kept)
                number += 1


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
