"""Adds 8-bit residuals of spiral textures to a picture, many pixels at a time. Source: gong-yang, sec. 5.2.

As :func:`ibrpipe.core.spiral.lookup.shade`, which is plainer and also takes linear residuals: every pixel asks the
texture that its ray suits best, and while weight is missing the next best. Here the pixels of some rows are taken
together, sorted into batches by texture, and every step of the look-up is one loop over a batch, so that the compiler
uses vectors.

Working memory: ``hit`` = (state, used, active, total), a number per hit pixel: see below; bits of the textures asked;
which hit pixel an entry is of, since those done are left out; sums of weighted R, G, B and weight. ``lanes`` = (work,
part, images, texel_idx), a number per pixel of a batch: see below; numbers of the four images; their four texels.

Symbols: q direction of the ray in a texture's frame, per camera depth; see also :mod:`ibrpipe.core.spiral.lookup`.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from ibrpipe.core.jit import inlined, kernel, ordered
from ibrpipe.core.spiral.lookup import TURN, decoded, encoded

#: rows of the picture that are taken together, pixels of a batch
ROWS, BATCH = 4, 256
#: rows of `state`, one number per hit pixel: pixel's centre, camera depth, length of its ray, best texture and how good
X, Y, Z, LENGTH, BEST, WORTH = range(6)
#: rows of `work`, one number per pixel of a batch: position in the rectangle, depth below it, pitch, yaw
U, V, BELOW, PITCH, YAW = range(5)
#: and: alpha on the turn below and above, share of the turn above
HERE, ABOVE, SHARE = range(5, 8)
#: rows of `part` (f32): weights of four images, of four texels, sums of R, G, B, weight
IMAGE, TEXEL, SUM = 0, 4, 8


@inlined
def arctangent(y, x):
    # atan2 without branches, to 1e-15: the rational approximation of Cephes (moshier1989) on [0, tan(pi / 8)]
    ay, ax = abs(y), abs(x)
    low, high = (ay, ax) if ay < ax else (ax, ay)
    high = high if high > 1e-300 else 1e-300
    a = low / high
    far = a > 0.41421356237309503
    b = (a - 1.0) / (a + 1.0) if far else a
    z = b * b
    top = (((-8.750608600031904122785e-1 * z - 1.615753718733365076637e1) * z - 7.500855792314704667340e1) * z
           - 1.228866684490136173410e2) * z - 6.485021904942025371773e1  # fmt: skip
    under = ((((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z + 4.328810604912902668951e2) * z
             + 4.853903996359136964868e2) * z + 1.945506571482613964425e2  # fmt: skip
    angle = b + b * z * top / under + (0.7853981633974483 if far else 0.0)
    angle = 1.5707963267948966 - angle if ay > ax else angle
    angle = 3.141592653589793 - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@ordered
def choose_textures(count, frames, used, state):
    # find the best texture of every pixel among those that it has not asked; frames: Q_of (T, 3, 3) pixel to direction
    # q, eyes (T, 3) the eye in the textures' frames, scales (T, 2) 1 / edge lengths, all f64
    Q_of, eyes, scales = frames
    for n in range(count):
        state[BEST, n], state[WORTH, n] = -1.0, -1.0
    for t in range(len(eyes)):
        t00, t01, t02, t10, t11, t12 = (
            Q_of[t, 0, 0], Q_of[t, 0, 1], Q_of[t, 0, 2], Q_of[t, 1, 0], Q_of[t, 1, 1], Q_of[t, 1, 2],
        )  # fmt: skip
        t20, t21, t22, e0, e1, e2 = Q_of[t, 2, 0], Q_of[t, 2, 1], Q_of[t, 2, 2], eyes[t, 0], eyes[t, 1], eyes[t, 2]
        su, sv, bit = scales[t, 0], scales[t, 1], np.int64(1) << t
        for n in range(count):
            x, y = state[X, n], state[Y, n]
            q0, q1 = t00 * x + t01 * y + t02, t10 * x + t11 * y + t12
            q2 = t20 * x + t21 * y + t22
            z, per = -q2 / state[LENGTH, n], e2 / q2
            u, v = (e0 - per * q0) * su, (e1 - per * q1) * sv  # where the ray passes through the rectangle's plane
            a, b = (-u if -u > u - 1.0 else u - 1.0), (-v if -v > v - 1.0 else v - 1.0)
            outside = a if a > b else b
            worth = 1.0 + z if outside <= 0.0 else z / (1.0 + outside) - 0.5
            better = (z > 0.02) & (worth > state[WORTH, n]) & ((used[n] & bit) == 0)
            state[WORTH, n] = worth if better else state[WORTH, n]
            state[BEST, n] = float(t) if better else state[BEST, n]


@ordered
def look_along(count, t, frames, spirals, work):
    # work: pixel's x, y, camera depth, length in rows HERE, ABOVE, SHARE, YAW -> positions, and alphas round the
    # direction; spirals: k, greatest pitch (T,) f64, images of the closing turn, last image (T,) i64
    (Q_of, eyes, scales), (ks, limits, closings, _) = frames, spirals
    t00, t01, t02, t10, t11, t12 = (
        Q_of[t, 0, 0], Q_of[t, 0, 1], Q_of[t, 0, 2], Q_of[t, 1, 0], Q_of[t, 1, 1], Q_of[t, 1, 2],
    )  # fmt: skip
    t20, t21, t22, e0, e1, e2 = Q_of[t, 2, 0], Q_of[t, 2, 1], Q_of[t, 2, 2], eyes[t, 0], eyes[t, 1], eyes[t, 2]
    su, sv, k, limit, closed = scales[t, 0], scales[t, 1], ks[t], limits[t], closings[t] > 0
    for n in range(count):
        x, y, z = work[HERE, n], work[ABOVE, n], work[SHARE, n]
        q0, q1 = t00 * x + t01 * y + t02, t10 * x + t11 * y + t12
        q2 = t20 * x + t21 * y + t22
        work[U, n], work[V, n], work[BELOW, n] = (e0 + z * q0) * su, (e1 + z * q1) * sv, -(e2 + z * q2)
        work[PITCH, n], work[YAW, n] = arctangent(np.sqrt(q0 * q0 + q1 * q1), -q2), arctangent(-q1, -q0)
    for n in range(count):
        p, q = work[PITCH, n], work[YAW, n]
        q = q + TURN if q < 0.0 else q
        q = 0.0 if q >= TURN else q
        here = TURN * np.floor((p - k * q) / (TURN * k)) + q
        above = here + TURN
        here = here if here > 0.0 else 0.0  # the pole stands in for the round before the first
        low, high = k * here, k * above
        high = limit if closed and limit < high else high
        share = (p - low) / (high - low) if high > low else 1.0
        share = share if share > 0.0 else 0.0
        share = share if share < 1.0 else 1.0
        work[HERE, n], work[ABOVE, n] = here, above
        work[SHARE, n] = 0.0 if closed and low >= limit else share


@ordered
def find_images(count, t, spirals, finds, work, part, images):
    # the two images round the alphas of the turn below, then those of the turn above, with their weights. finds:
    # alphas, those of the next images (D,) f64, next images (D,) u32, guesses (G,) u32: image at the begin of every bin
    # of alpha, of texture t from firsts[t] on, (T + 1,) i64, bins[t] per radian, (T,) f64
    (_, _, closings, lasts), (alphas, nexts, partners, guesses, firsts, bins) = spirals, finds
    closed, last = closings[t] > 0, lasts[t]
    circle = alphas[last + 1 - closings[t]] if closed else np.inf
    first, end, per = firsts[t], firsts[t + 1] - 1, bins[t]
    for turn in range(2):
        for n in range(count):
            alpha = work[HERE + turn, n]
            past = alpha - circle
            alpha = circle + (past - TURN * np.floor(past / TURN)) if past >= 0.0 else alpha
            at = first + np.int64(alpha * per)
            images[2 * turn, n] = guesses[np.uint32(at if at < end else end)]
            work[PITCH + turn, n] = alpha
        for n in range(count):
            image = images[2 * turn, n]
            image += np.uint32(1) if nexts[image] <= work[PITCH + turn, n] else np.uint32(0)
            images[2 * turn, n] = image
        for n in range(count):
            image = images[2 * turn, n]
            below = alphas[image]
            along = (work[PITCH + turn, n] - below) / (nexts[image] - below)
            mine = work[SHARE, n] if turn else 1.0 - work[SHARE, n]
            images[2 * turn + 1, n] = partners[image]
            part[IMAGE + 2 * turn, n], part[IMAGE + 2 * turn + 1, n] = mine * (1.0 - along), mine * along


@ordered
def add_images(count, t, tables, work, part, images, texel_idx):
    # read the four images where the ray from the point along each image's direction leaves the rectangle; tables:
    # directions (D, 2) f64 shift in the rectangle per depth below it, sizes (D, 2) f64 height and width, starts (D +
    # 1,) i64, texels (N,) u32 R, G, B and 1 where valid, zeros (T,) f32 code of nothing
    directions, sizes, starts, texels, zeros = tables
    zero = zeros[t]
    for n in range(count):
        part[SUM, n], part[SUM + 1, n], part[SUM + 2, n], part[SUM + 3, n] = 0.0, 0.0, 0.0, 0.0
    for m in range(4):
        for n in range(count):
            image, below = images[m, n], work[BELOW, n]
            height, width = sizes[image, 0], sizes[image, 1]
            x = (work[U, n] + below * directions[image, 0]) * width - 0.5
            y = (work[V, n] + below * directions[image, 1]) * height - 0.5
            inside = (x > -1.0) & (y > -1.0) & (x < width) & (y < height)
            x, y = (x if inside else 0.0), (y if inside else 0.0)
            column, row = np.floor(x), np.floor(y)
            x, y, weight = x - column, y - row, float(part[IMAGE + m, n]) if inside else 0.0
            left, upper = 1.0 - x if column >= 0.0 else 0.0, 1.0 - y if row >= 0.0 else 0.0
            right, lower = x if column + 1.0 < width else 0.0, y if row + 1.0 < height else 0.0
            c0, r0 = column if column > 0.0 else 0.0, row if row > 0.0 else 0.0
            c1 = column + 1.0 if column + 1.0 < width else c0
            r1 = row + 1.0 if row + 1.0 < height else r0
            begin = float(starts[image])
            part[TEXEL, n], part[TEXEL + 1, n] = weight * left * upper, weight * right * upper
            part[TEXEL + 2, n], part[TEXEL + 3, n] = weight * left * lower, weight * right * lower
            texel_idx[0, n], texel_idx[1, n] = np.int64(begin + r0 * width + c0), np.int64(begin + r0 * width + c1)
            texel_idx[2, n], texel_idx[3, n] = np.int64(begin + r1 * width + c0), np.int64(begin + r1 * width + c1)
        for corner in range(4):
            for n in range(count):
                texel = texels[texel_idx[corner, n]]
                weight = part[TEXEL + corner, n] if texel >= np.uint32(1 << 24) else np.float32(0.0)
                part[SUM, n] += weight * (np.float32(np.int32(texel & np.uint32(255))) - zero)
                part[SUM + 1, n] += weight * (np.float32(np.int32((texel >> np.uint32(8)) & np.uint32(255))) - zero)
                part[SUM + 2, n] += weight * (np.float32(np.int32((texel >> np.uint32(16)) & np.uint32(255))) - zero)
                part[SUM + 3, n] += weight


@ordered
def list_hits(depth, known, row, grid, world_from_pixel, state, pixels, used, active, total):
    # list the pixels of ROWS rows from `row` on that are hit and have a colour -> how many there are
    count, columns = 0, depth.shape[1]
    for y in range(row, min(row + ROWS, depth.shape[0])):
        for x in range(columns):
            if depth[y, x] < np.inf and known[y, x] > 0.0:
                state[X, count], state[Y, count] = grid[0][y, 0] + grid[1][x, 0], grid[0][y, 1] + grid[1][x, 1]
                state[Z, count] = depth[y, x]
                pixels[count], active[count], used[count] = y * columns + x, count, 0
                count += 1
    w = world_from_pixel
    for n in range(count):
        x, y = state[X, n], state[Y, n]
        a, b = w[0, 0] * x + w[0, 1] * y + w[0, 2], w[1, 0] * x + w[1, 1] * y + w[1, 2]
        c = w[2, 0] * x + w[2, 1] * y + w[2, 2]
        state[LENGTH, n] = np.sqrt(a * a + b * b + c * c)
        total[0, n], total[1, n], total[2, n], total[3, n] = 0.0, 0.0, 0.0, 0.0
    return count


@ordered
def add_to_colors(count, pixels, total, encode, decode, color):
    # add the residuals found, in display code, and count the pixels that found none
    lost, last, columns = 0, len(encode) - 1, color.shape[1]
    for n in range(count):
        if total[3, n] < 1e-3:
            lost += 1
            continue
        y, x = pixels[n] // columns, pixels[n] % columns
        scale = np.float32(1.0 / 255.0) / total[3, n]
        for c in range(3):
            value = color[y, x, c]
            if value < 1.0:
                at = np.sqrt(value if value > 0.0 else np.float32(0.0)) * last
                i = int(at)
                code = encode[i] + (at - i) * (encode[i + 1] - encode[i])
            else:
                code = encoded(value)
            code = code + total[c, n] * scale
            if code < 1.0:
                at = (code if code > 0.0 else np.float32(0.0)) * last
                i = int(at)
                color[y, x, c] = decode[i] + (at - i) * (decode[i + 1] - decode[i])
            else:
                color[y, x, c] = decoded(code)
    return lost


@ordered
def ask_texture(count, t, batch, frames, spirals, finds, tables, hit, lanes):
    # add what texture t says to the pixels batch[:count]
    (state, used, active, total), (work, part, images, texel_idx) = hit, lanes
    for n in range(count):
        at = batch[t, n]
        work[HERE, n], work[ABOVE, n], work[SHARE, n] = state[X, at], state[Y, at], state[Z, at]
        used[at] |= np.int64(1) << t
    look_along(count, t, frames, spirals, work)
    find_images(count, t, spirals, finds, work, part, images)
    add_images(count, t, tables, work, part, images, texel_idx)
    for n in range(count):
        to = active[batch[t, n]]
        for c in range(4):
            total[c, to] += part[SUM + c, n]


@ordered
def ask_textures(hits, frames, spirals, finds, tables, hit, lanes, batch, counts):
    # every pixel asks its best texture, and while weight is missing the next best
    state, used, active, total = hit
    count = hits
    while count > 0:
        choose_textures(count, frames, used, state)
        for n in range(count):
            t = np.int64(state[BEST, n])
            if t < 0:
                continue
            batch[t, counts[t]] = n
            counts[t] += 1
            if counts[t] == BATCH:
                ask_texture(BATCH, t, batch, frames, spirals, finds, tables, hit, lanes)
                counts[t] = 0
        for t in range(len(counts)):
            ask_texture(counts[t], t, batch, frames, spirals, finds, tables, hit, lanes)
            counts[t] = 0
        left = 0
        for n in range(count):
            if state[BEST, n] >= 0.0 and total[3, active[n]] <= 0.98:
                state[X, left], state[Y, left], state[Z, left] = state[X, n], state[Y, n], state[Z, n]
                state[LENGTH, left], used[left], active[left] = state[LENGTH, n], used[n], active[n]
                left += 1
        count = left


@kernel
def add_residuals(
    color, depth, known, grid, world_from_pixel, frames, spirals, finds, tables, encode, decode, lost
):  # fmt: skip
    # color (h, w, 3) f32 linear, in and out; depth (h, w) f32 along camera z; known (h, w) f32: 0 = leave alone
    # grid = (rows (h, 2), columns (w, 2)) f64: ray (y, x) passes through rows[y] + columns[x] of the picture
    # frames: see choose_textures; spirals: look_along; finds: find_images; tables: add_images; encode, decode (E,)
    # f32: code of linear (i / (E - 1))^2, linear of code i / (E - 1); lost (parts,) i64: hits without a residual
    rows, columns = depth.shape
    parts, units, size, textures = len(lost), (rows + ROWS - 1) // ROWS, ROWS * columns, len(frames[1])
    for each in prange(parts):
        own = np.int64(each)  # prange counts unsigned
        state, total = np.empty((6, size)), np.empty((4, size), np.float32)
        pixels, used, active = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size, np.int64)
        work, part = np.empty((8, BATCH)), np.empty((12, BATCH), np.float32)
        images, texel_idx = np.empty((4, BATCH), np.uint32), np.empty((4, BATCH), np.uint32)
        batch, counts = np.empty((textures, BATCH), np.int64), np.zeros(textures, np.int64)
        lost[own] = 0
        for unit in range(own, units, parts):
            hits = list_hits(depth, known, unit * ROWS, grid, world_from_pixel, state, pixels, used, active, total)
            ask_textures(
                hits, frames, spirals, finds, tables, (state, used, active, total), (work, part, images, texel_idx),
                batch, counts,
            )  # fmt: skip
            lost[own] += add_to_colors(hits, pixels, total, encode, decode, color)
