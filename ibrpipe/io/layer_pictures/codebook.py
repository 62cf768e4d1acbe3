"""Vector quantisation of colours: blocks of 2 x 2 texels as words of one codebook a texture. Source: gong-yang."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np

from ibrpipe.errors import FormatError
from ibrpipe.io.layer_pictures.bounded import inflate
from ibrpipe.types import Array

#: numbers of a word: three channels of 2 x 2 texels
SIZE = 12
_ROUNDS = 12


def pack_blocks(pictures: Sequence[Array], theres: Sequence[Array], count: int) -> tuple[bytes, bytes]:
    """Return the words and the word of every block of pictures (h, w, 3) uint8 that has a texel that is there.

    Words are found by k-means with a fixed seed, so that the same pictures give the same bytes.
    """
    from scipy.cluster.vq import kmeans2, vq

    blocks = [_blocks(picture)[_used(there)] for picture, there in zip(pictures, theres, strict=True)]
    every = np.concatenate([np.zeros((0, SIZE)), *blocks])
    if not len(every):
        return b"", zlib.compress(b"")
    distinct = np.unique(every, axis=0)
    if len(distinct) > count:
        found, _ = kmeans2(every, count, _ROUNDS, minit="++", missing="warn", rng=np.random.default_rng(0))
        distinct = np.unique(np.round(found), axis=0)
    indices, _ = vq(every, distinct)
    return distinct.astype(np.uint8).tobytes(), zlib.compress(indices.astype("<u2").tobytes(), 9)


def unpack_blocks(words: bytes, indices: bytes, theres: Sequence[Array]) -> list[Array]:
    """Return the pictures (h, w, 3) uint8.

    Raises
    ------
    FormatError
        Words or blocks are missing.
    """
    used = [_used(there) for there in theres]
    count = sum(int(each.sum()) for each in used)
    book = np.frombuffer(words, np.uint8).reshape(-1, SIZE)
    chosen = np.frombuffer(inflate(indices, 2 * count), "<u2")
    if count and chosen.max() >= len(book):
        raise FormatError(f"a block has word {chosen.max()} of {len(book)}")
    found, start = [], 0
    for there, blocks in zip(theres, used, strict=True):
        end = start + int(blocks.sum())
        cells = np.zeros((*blocks.shape, 2, 2, 3), np.uint8)
        cells[blocks] = book[chosen[start:end]].reshape(-1, 2, 2, 3)
        rows, columns = blocks.shape
        whole = cells.transpose(0, 2, 1, 3, 4).reshape(2 * rows, 2 * columns, 3)
        found.append(whole[: there.shape[0], : there.shape[1]])
        start = end
    return found


def _blocks(picture: Array) -> Array:
    """Return the blocks (h / 2, w / 2, 12) of a picture, whose last row and column are repeated where odd."""
    height, width = picture.shape[:2]
    even = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge").astype(np.float64)
    cells = even.reshape(even.shape[0] // 2, 2, even.shape[1] // 2, 2, 3).transpose(0, 2, 1, 3, 4)
    return cells.reshape(*cells.shape[:2], SIZE)


def _used(there: Array) -> Array:
    """Return which blocks have a texel that is there."""
    even = np.pad(there, ((0, there.shape[0] % 2), (0, there.shape[1] % 2)))
    used: Array = even.reshape(even.shape[0] // 2, 2, even.shape[1] // 2, 2).max(axis=(1, 3))
    return used
