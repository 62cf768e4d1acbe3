"""The registry of kinds, what kinds share on disk, and entries of several files."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import ClassVar

import numpy as np
import pytest

from ibrpipe.errors import ConfigError, FormatError
from ibrpipe.io import components
from ibrpipe.io.assets import bytes_by_kind, read_asset, read_index, write_asset
from ibrpipe.io.components import Component, ComponentFiles, ComponentKind, find_kind, known_kinds, register
from ibrpipe.types import Asset, LayeredDepthImage, ParallelFrame, Texture
from ibrpipe.types.view_dependence import ViewDependence

FRAME = ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
LAYERS = LayeredDepthImage(FRAME, np.arange(2)[None], np.ones(1), np.ones((1, 3)), np.ones((1, 3)))


@dataclass(frozen=True)
class Book:
    words: tuple[int, ...]

    @property
    def bytes(self):
        return 8 * len(self.words)


@dataclass(frozen=True)
class Coded(ViewDependence):
    kind: ClassVar[str] = "coded"
    book: Book
    code: int

    @property
    def bytes(self):
        return 8

    @property
    def shared(self):
        return self.book


class CodedFiles(ComponentFiles):
    def write(self, component, folder, quality):
        for name in ("low", "high"):
            (folder / name).write_text(str(component.code))
        return {"files": ["low", "high"], "quality": quality}

    def read(self, entry, root, shared):
        return Coded(shared, int((root / entry.files[1]).read_text()))

    def write_shared(self, shared, folder, quality):
        (folder / "book.json").write_text(json.dumps(shared.words))
        return {"file": "book.json"}

    def read_shared(self, entry, root):
        return Book(tuple(json.loads((root / entry.file).read_text())))


class Lonely(CodedFiles):
    write_shared = ComponentFiles.write_shared


CODED = ComponentKind("coded", "Codes of a book.", CodedFiles, object)


@pytest.fixture(autouse=True)
def own_registry(monkeypatch):
    monkeypatch.setattr(components, "_known", dict(components._known))


def asset():
    book = Book((3, 5, 8))
    return Asset((Texture(LAYERS, (Coded(book, 1),)), Texture(LAYERS, (Coded(book, 2),)), Texture(LAYERS)))


def test_what_is_shared_is_stored_once(tmp_path):
    register(CODED)
    write_asset(asset(), tmp_path / "asset", quality=80)
    back = read_asset(tmp_path / "asset")
    one, two = (back.textures[i].component("coded") for i in range(2))
    assert (one.code, two.code) == (1, 2)
    assert one.shared is two.shared is back.shared["coded"]
    assert one.shared == Book((3, 5, 8))
    index = read_index(tmp_path / "asset")
    assert index.shared == [Component(kind="coded", file="book.json")]
    entry = index.textures[1].components[0]
    assert (entry.paths, entry.model_extra) == (("texture_01/low", "texture_01/high"), {"quality": 80})
    assert bytes_by_kind(index, tmp_path / "asset") == {"coded": 4 * 1 + len("[3, 5, 8]")}
    write_asset(back, tmp_path / "again", quality=80)
    for file in (tmp_path / "asset").rglob("*.*"):
        assert (tmp_path / "again" / file.relative_to(tmp_path / "asset")).read_bytes() == file.read_bytes()


def test_shared_data_of_an_unknown_kind_is_refused(tmp_path):
    register(CODED)
    write_asset(asset(), tmp_path / "asset")
    del components._known["coded"]
    with pytest.raises(
        FormatError, match=r"asset\.json: the asset has a component of kind 'coded'.*use a newer ibrpipe"
    ):
        read_asset(tmp_path / "asset")


def test_a_kind_that_cannot_share_says_so(tmp_path):
    register(ComponentKind("coded", "", Lonely, object))
    with pytest.raises(ConfigError, match="Lonely cannot write shared data"):
        write_asset(asset(), tmp_path / "asset")


def test_the_same_kind_may_be_registered_twice_but_not_another_of_its_name():
    register(CODED)
    register(CODED)
    assert known_kinds() == ("spiral", "reflection", "photos", "coded")
    with pytest.raises(ConfigError, match="'coded' already"):
        register(ComponentKind("coded", "", Lonely, object))


@pytest.mark.parametrize("name", ["", "Tint", "a b", "../x"])
def test_a_name_of_another_form_is_refused(name):
    with pytest.raises(ConfigError, match="no name of a kind"):
        register(ComponentKind(name, "", CodedFiles, object))


@pytest.mark.parametrize("where", ["nowhere.at.all:Files", "ibrpipe.io.components:Nothing"])
def test_a_part_that_cannot_be_imported_is_named(where):
    register(ComponentKind("coded", "", where, object))
    with pytest.raises(ConfigError, match=f"'coded' cannot be loaded from {where}"):
        find_kind("coded").part("files", ComponentFiles)


def test_a_part_that_is_missing_or_of_another_form_is_named():
    with pytest.raises(ConfigError, match="'coded' has no fitting"):
        CODED.part("fitting", ComponentFiles)
    with pytest.raises(ConfigError, match="drawing of kind 'coded' is object, which is no ComponentFiles"):
        CODED.part("drawing", ComponentFiles)


def test_every_part_of_the_spiral_keeps_its_contract():
    from ibrpipe.modelling.view_dependence.fitter import Fitter
    from ibrpipe.renderers.view_dependence.component import ComponentDrawer

    kind = find_kind("spiral")
    for part, contract in (("files", ComponentFiles), ("drawing", ComponentDrawer), ("fitting", Fitter)):
        assert isinstance(kind.part(part, contract), contract)


@pytest.mark.parametrize(("value", "told"), [("CODED", None), ("Book", "is no ComponentKind called 'coded'")])
def test_other_packages_bring_kinds_by_entry_points(monkeypatch, value, told):
    entry = EntryPoint("coded", f"{__name__}:{value}", components.GROUP)
    monkeypatch.setattr(components, "entry_points", lambda group: [entry] if group == components.GROUP else [])
    for cached in (components._foreign, components._from_package):
        cached.cache_clear()
    try:
        assert known_kinds() == ("spiral", "reflection", "photos", "coded")
        if told is None:
            assert find_kind("coded") is CODED or find_kind("coded").name == "coded"
        else:
            with pytest.raises(ConfigError, match=told):
                find_kind("coded")
    finally:
        components._foreign.cache_clear()
        components._from_package.cache_clear()
