"""Textures and their components: what they refuse, what they find, what an asset's textures share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from ibrpipe.core.spiral import directions
from ibrpipe.errors import ShapeError, ValueRangeError
from ibrpipe.types import Asset, LayeredDepthImage, ParallelFrame, SpiralResiduals, SpiralTexture, Texture
from ibrpipe.types.view_dependence import ViewDependence

FRAME = ParallelFrame((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
LAYERS = LayeredDepthImage(FRAME, np.zeros((1, 2)), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))


@dataclass(frozen=True)
class Book:
    bytes: int = 100


@dataclass(frozen=True)
class Coded(ViewDependence):
    kind: ClassVar[str] = "coded"
    book: Book

    @property
    def bytes(self):
        return 4

    @property
    def shared(self):
        return self.book


def spiral():
    alphas = directions.table(1 / 4)
    count = len(alphas)
    ways, sizes = directions.directions(alphas, 1 / 4), np.ones((count, 2), np.int32)
    texels = np.zeros((count, 3), np.uint8)
    return SpiralResiduals(FRAME, 1 / 4, alphas, ways, sizes, np.arange(count + 1), texels, np.ones(count, bool))


def test_a_spiral_texture_is_a_texture_with_one_component():
    residuals = spiral()
    texture = SpiralTexture(LAYERS, residuals)
    assert isinstance(texture, Texture)
    assert texture.components == (residuals,)
    assert texture.residuals is residuals
    assert SpiralTexture(LAYERS).components == ()
    assert Texture(LAYERS).residuals is None


def test_components_are_found_by_kind():
    residuals, coded = spiral(), Coded(Book())
    texture = Texture(LAYERS, [coded, residuals])
    assert texture.components == (coded, residuals)
    assert texture.component("coded") is coded
    assert texture.residuals is residuals
    assert texture.component("tint") is None


def test_a_spiral_says_its_kind_and_bytes():
    residuals = spiral()
    count = len(residuals.alphas)
    assert (residuals.kind, residuals.shared) == ("spiral", None)
    assert residuals.bytes == count * (8 + 24 + 2 * 4 + 3 + 1) + (count + 1) * residuals.starts.itemsize


def test_two_of_one_kind_are_refused():
    with pytest.raises(ValueRangeError, match="two components of kind 'spiral'; a texture takes one of each kind"):
        Texture(LAYERS, (spiral(), spiral()))


@pytest.mark.parametrize(("wrong", "match"), [(spiral(), "put it into a tuple"), ((1,), "got int")])
def test_what_is_no_component_is_refused(wrong, match):
    with pytest.raises(ShapeError, match=match):
        Texture(LAYERS, wrong)


def test_an_asset_knows_its_kinds_and_what_they_share():
    book = Book()
    asset = Asset((Texture(LAYERS, (Coded(book),)), Texture(LAYERS, (spiral(), Coded(book))), Texture(LAYERS)))
    assert asset.kinds == ("coded", "spiral")
    assert asset.shared == {"coded": book}
    with pytest.raises(ValueRangeError, match="'coded' share two different objects"):
        _ = Asset((Texture(LAYERS, (Coded(Book()),)), Texture(LAYERS, (Coded(Book()),)))).shared
