"""Epipolar lines of a field: which lines of the reference cover the picture, and where a pixel lies among them.

Rays of one eye E that share an epipolar plane cross a field along one line of the reference, which passes through the
epipole, E's position in the reference (schaufler1999, sec. 4). A ray is straight in the field's coordinates
(:mod:`ibrpipe.core.rays`); the direction in which it crosses the reference is ``W = P_q Q - Q_q P``, linear in the
pixel, and W = 0 is the epipole of the picture. The picture falls into up to four *sectors* by W's longer component and
its sign, so that in each sector rays pass the columns of cells in one order, away from the epipole (``P_q > 0``) or
toward it (``P_q < 0``, the antipode of fig. 8); epipoles at infinity (``P_q = 0``) need no case of their own.

In a sector, *along* is the coordinate that grows along its rays, *across* the other one. All lines of a sector cross
the column ``along = far``; where they do so numbers them (``line``), and a straight step through the picture numbers
the pixels along a line (``bin``). At another column, rays are ``across = keep * across_far + shift_across`` and
``d = keep * d_far + shift_d``, so that one pass over a line's columns serves all its pixels.

Symbols: P, Q of :mod:`ibrpipe.core.rays`; sector rows are named by the constants below.
"""

from __future__ import annotations

import math

import numpy as np

#: rows of a sector: how lines are numbered, ``line = (LINE . p) / (TURN . p)``, ``bin = BIN . p`` for p = (px, py, 1)
LINE, TURN, BIN = 0, 3, 6
#: sizes and offsets: first entry of the table, steps per line and per bin, numbers of lines and of bins
FIRST, LINE_STEP, BIN_STEP, LINES, BINS = 9, 10, 11, 12, 13
#: geometry: axis that is `along` (0 = u), its direction, cells along and across, level of the blocks
AXIS, SIGN, ALONG, ACROSS, LEVEL = 14, 15, 16, 17, 18
#: across_far of line 0's lower edge, width of a line there
EDGE, WIDTH = 19, 20
#: a point (across, d) of the far column is at bin ``(over . (across, d, 1)) / (under . (across, d, 1))``
OVER, UNDER = 21, 24
#: is the sector in use; sign of P_q
USED, OUTWARD = 27, 28
#: columns of blocks, in walking order, that rays of the sector can meet: first, and one past the last
FROM, TO = 29, 30
SECTOR_SIZE = 31
#: least share of the distance to the far column at which a column is still told from the epipole
NEAREST = 1e-12
#: cells about the field at which lines are still laid
MARGIN = 1.0


def lay_lines(start, Q_of, pixels, cells, size, spacing, finest, coarseness, depths=(-math.inf, math.inf)):
    """Return (sectors (4, SECTOR_SIZE) f64, edges (4, 4, n) f64, entries) of one field and camera.

    Parameters
    ----------
    start, Q_of : (4,), (4, 3) float64
        Rays in the field's coordinates.
    pixels : (3, 4) float64
        (u, v, d, 1) to homogeneous pixels.
    cells : (columns, rows)
    size : (width, height) of the picture
    spacing : float
        Greatest width of a line in the picture, pixels.
    finest : float
        Least width of a line in the reference, cells.
    coarseness : float
        Blocks are at most this many times as wide as lines.
    depths : (least, greatest)
        Depths d that the field has.

    Returns
    -------
    sectors
        See the constants of this module.
    edges
        For every sector ``keep``, ``shift_across``, ``shift_d`` and ``1 / keep`` at the edges of its columns of blocks.
    entries : int
        Entries of the table of all sectors; the first is for pixels that have no line.
    """
    sectors, edges, entries = np.zeros((4, SECTOR_SIZE)), [np.zeros((4, 1))] * 4, 1
    starts, rows, pixels = start.tolist(), Q_of.tolist(), pixels.tolist()  # plain numbers are quicker one by one
    cells = (float(cells[0]), float(cells[1]))
    for number in range(4):
        axis, sign, own = number >> 1, -1.0 if number & 1 else 1.0, [0.0] * SECTOR_SIZE
        P, Q = _along_and_across(starts, rows, axis, sign, cells)
        if _lay_sector(own, axis, sign, P, Q, pixels, cells, size, spacing, finest, coarseness, depths):
            own[FIRST] = entries
            entries += int(own[LINES] * own[BINS])
            sectors[number], edges[number] = own, _column_edges(own, P)
    packed = np.zeros((4, 4, max(part.shape[1] for part in edges)))
    for part, position in zip(edges, packed, strict=True):
        position[:, : part.shape[1]] = part
    return sectors, packed, entries


def _along_and_across(start, Q_of, axis, sign, cells):
    """Return start (4,) and Q_of (4, 3) as (along, across, d, q) rows."""
    along, directions = start[axis], Q_of[axis]
    if sign < 0:
        along = cells[axis] * start[3] - along
        directions = [cells[axis] * q - direction for q, direction in zip(Q_of[3], directions, strict=True)]
    return (along, start[1 - axis], start[2], start[3]), (directions, Q_of[1 - axis], Q_of[2], Q_of[3])


def _lay_sector(own, axis, sign, P, Q, pixels, cells, size, spacing, finest, coarseness, depths):
    """Fill one sector; False where no pixel lies in it or no ray of it can meet the field."""
    length, breadth = cells[axis], cells[1 - axis]
    outward = P[3] >= 0.0
    far = length if outward else 0.0
    reach = far * P[3] - P[0]
    if not reach > NEAREST * (abs(far * P[3]) + abs(P[0])):
        return False
    along = [P[3] * a - q * P[0] for a, q in zip(Q[0], Q[3], strict=True)]
    across = [P[3] * a - q * P[1] for a, q in zip(Q[1], Q[3], strict=True)]
    below = [a - b for a, b in zip(along, across, strict=True)]
    above = [a + b for a, b in zip(along, across, strict=True)]
    region = _clip(_clip([(0.0, 0.0), (size[0], 0.0), size, (0.0, size[1])], below), above)
    scale = max(map(abs, along + across)) * max(size) * 1e-9
    corners = [p for p in region if _at(along, p) > scale]
    if not corners:
        return False
    # across_far = line / along, from the line's coefficients P x Q in (along, across, q)
    line = [
        far * (P[3] * q1 - P[1] * q3) + (P[1] * q0 - P[0] * q1) for q0, q1, q3 in zip(Q[0], Q[1], Q[3], strict=True)
    ]
    positions, slopes = [], []
    for p in corners:
        under = _at(along, p)
        position = _at(line, p) / under
        positions.append(position)
        slopes.append(((line[0] - position * along[0]) / under, (line[1] - position * along[1]) / under))
    least, greatest = _crossing(P, far, reach, length, breadth)
    low, high = max(min(positions), least), min(max(positions), greatest)
    steep = min(math.hypot(*slope) for slope in slopes)
    width = max(spacing * steep, finest, (high - low) / (4.0 * (size[0] + size[1])))
    if not low <= high or not 0.0 < width < math.inf:
        return False
    own[LINES] = math.floor((high - low) / width) + 2
    own[EDGE], own[WIDTH] = low - 0.5 * width, width
    own[LINE : LINE + 3] = [(a - own[EDGE] * b) / width for a, b in zip(line, along, strict=True)]
    own[TURN : TURN + 3] = along
    own[AXIS], own[SIGN], own[ALONG], own[ACROSS], own[OUTWARD] = axis, sign, length, breadth, 1.0 if outward else -1.0
    top = (int(max(cells)) - 1).bit_length()  # one block holds all cells there
    own[LEVEL] = min(math.floor(math.log2(max(coarseness * width, 1.0))), top)
    _number_bins(own, region, slopes, pixels, far)
    own[FROM], own[TO] = _reach_columns(P, Q, region, length, depths, 2.0 ** own[LEVEL])
    own[USED] = 1.0
    return True


def _crossing(P, far, reach, length, breadth):
    """Return the least and the greatest across_far of lines that cross the field, or come as near as MARGIN."""
    end = length - far  # the field's other column, or the epipole before it
    if P[3] != 0.0:
        end = max(end, P[0] / P[3]) if P[3] > 0.0 else min(end, P[0] / P[3])
    keep, shift = (end * P[3] - P[0]) / reach, (far - end) / reach * P[1]
    bounds = []
    for edge, sign in ((-MARGIN, -1.0), (breadth + MARGIN, 1.0)):
        beyond = sign * (edge - shift)  # how far within this edge the epipole, or what all lines are moved by, lies
        there = sign * edge + length
        if keep > NEAREST:
            there = min(there, max(sign * edge, sign * (edge - shift) / keep))
        elif beyond < 0.0:
            there = sign * edge
        bounds.append(sign * there)
    return bounds


def _clip(corners, line):
    """Return the part of a polygon where ``line . (x, y, 1) >= 0``."""
    sides = [line[0] * x + line[1] * y + line[2] for x, y in corners]
    kept = []
    for n, (x, y) in enumerate(corners):
        other = n - 1
        if (sides[n] >= 0.0) != (sides[other] >= 0.0):
            share = sides[n] / (sides[n] - sides[other])
            kept.append((x + share * (corners[other][0] - x), y + share * (corners[other][1] - y)))
        if sides[n] >= 0.0:
            kept.append((x, y))
    return kept


def _reach_columns(P, Q, corners, length, depths, block):
    """Return the first column of blocks, and one past the last, that rays through a polygon of the picture can meet."""
    first, last, blocks = 0.0, length, math.ceil(length / block)
    if P[3] == 1.0 and not any(Q[3]) and math.isfinite(depths[0]):
        first, rays = max(first, P[0]), [(_at(Q[0], p), _at(Q[2], p)) for p in corners]
        for depth, sign in ((depths[0], 1.0), (depths[1], -1.0)):
            if sign * (depth - P[2]) > 0.0:  # the eye is beyond this bound, and rays enter by it
                entries = [P[0] + (depth - P[2]) / d * along for along, d in rays if sign * d > 0.0]
                first = max(first, min(entries, default=length))
            if sign * (depth - P[2]) < 0.0 and all(sign * d < 0.0 for _, d in rays):  # rays end at it
                last = min(last, max(P[0] + (depth - P[2]) / d * along for along, d in rays))
    return max(math.floor(first / block - 0.01), 0.0), min(math.floor(last / block + 0.01) + 1.0, float(blocks))


def _at(row, position):
    return row[0] * position[0] + row[1] * position[1] + row[2]


def _number_bins(own, region, slopes, pixels, far):
    """Lay bins of one pixel along the mean direction of the sector's lines in the picture."""
    x = sum(-b / math.hypot(a, b) for a, b in slopes if a or b)
    y = sum(a / math.hypot(a, b) for a, b in slopes if a or b)
    length = math.hypot(x, y)
    x, y = (x / length, y / length) if length > 0.0 else (0.0, 1.0)
    positions = [x * p[0] + y * p[1] for p in region]
    shift = 1.0 - math.floor(min(positions))
    own[BIN : BIN + 3] = (x, y, shift)
    own[BINS] = math.floor(max(positions)) + shift + 2.0
    own[LINE_STEP], own[BIN_STEP] = (1.0, own[LINES]) if abs(y) > abs(x) else (own[BINS], 1.0)
    over = [x * a + y * b + shift * c for a, b, c in zip(*pixels, strict=True)]
    axis, position = int(own[AXIS]), far if own[SIGN] > 0 else own[ALONG] - far
    for first, row in ((OVER, over), (UNDER, pixels[2])):
        own[first : first + 3] = (row[1 - axis], row[2], row[axis] * position + row[3])


def _column_edges(own, P):
    """Return keep, shift_across, shift_d, 1 / keep (4, n) at the edges of the columns of blocks, in walking order."""
    step = 2 ** int(own[LEVEL])
    blocks = -(-int(own[ALONG]) // step)
    edges = np.minimum(np.arange(blocks + 1.0) * step, own[ALONG])
    if own[SIGN] < 0:
        edges = (own[ALONG] - edges)[::-1]
    far = own[ALONG] if own[OUTWARD] > 0 else 0.0
    reach = far * P[3] - P[0]
    keep = np.maximum((edges * P[3] - P[0]) / reach, NEAREST)
    if P[3] != 0.0:  # edges beyond the epipole stay at it
        edges = np.maximum(edges, P[0] / P[3]) if own[OUTWARD] > 0 else np.minimum(edges, P[0] / P[3])
    return np.stack([keep, (far - edges) / reach * P[1], (far - edges) / reach * P[2], 1.0 / keep])
