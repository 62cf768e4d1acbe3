"""The compact form of layered depth images: a picture per layer and kind of value, each coded by what suits it."""

from ibrpipe.io.layer_pictures.archive import NAME, read_layer_pictures, write_layer_pictures
from ibrpipe.io.layer_pictures.coding import LOSSLESS, Coding

__all__ = ["LOSSLESS", "NAME", "Coding", "read_layer_pictures", "write_layer_pictures"]
