"""Where the slices of drawn parts lie in the picture.

A slice is a plane across its part: pixel (x, y) sees its texel (u, v) by a homography, the inverse of the matrix with
columns K M a, K M b, K (M (c + h d) + t); a, b: one texel, d: towards the viewer, h: height of the slab's outline.

A part narrower than a pixel is drawn a pixel wide, and covers as much less: pixels' middles would miss it, or not, by
chance.

A slice's numbers are (14,) f64: rows of u w, v w, w over (x, y, 1), its gains of red, green, blue, coverage, and how
much thicker it is seen than it was made; and (8,) i64: first and last column and row (exclusive), first shaded texel,
width, height, 0.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from ibrpipe.core.hierarchy.shade import irradiance, lights_of_key
from ibrpipe.core.hierarchy.traverse import determinant, octahedral_cell, solve, stretch
from ibrpipe.core.jit import helper, kernel

#: cells along a side of the octahedral map of light directions
BINS = 16
#: cosines below which a slab is not thickened, and what spread normals gain that are seen less at a slant
_LEAST_COSINE, _UNSEEN = 0.05, 16.0 / 9.0


@kernel
def find_keys(nodes, choices, poses, lights, levels, directions, keys):
    # lights (N, 3) f64 in the camera's frame -> keys (I, 2) i64: stack, and the bins of the lights in the part's frame
    for i in prange(len(nodes)):
        keys[i, 0] = (nodes[i] * levels + (choices[i] >> 16)) * directions + (choices[i] & 0xFFFF)
        det = determinant(poses[i])
        key = 0
        for n in range(len(lights)):
            x, y, z = solve(poses[i], det, lights[n, 0], lights[n, 1], lights[n, 2])
            key |= octahedral_cell(x, y, z, BINS) << (8 * n)
        keys[i, 1] = key


@helper
def box_of(forward, u, v, width, height, limits, out):
    # pixels that texels u .. u + width, v .. v + height may show on, half a texel wider -> out (4,) x0, x1, y0, y1
    low_x, high_x, low_y, high_y = np.inf, -np.inf, np.inf, -np.inf
    for corner in range(4):
        p = u - 0.5 + (corner & 1) * (width + 1.0)
        q = v - 0.5 + (corner >> 1) * (height + 1.0)
        w = forward[6] * p + forward[7] * q + forward[8]
        if not w > 0.0:
            return False
        x = (forward[0] * p + forward[1] * q + forward[2]) / w
        y = (forward[3] * p + forward[4] * q + forward[5]) / w
        low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
    out[0] = int(max(math.floor(low_x), 0.0))
    out[1] = int(min(math.ceil(high_x), limits[0]))
    out[2] = int(max(math.floor(low_y), 0.0))
    out[3] = int(min(math.ceil(high_y), limits[1]))
    return out[0] < out[1] and out[2] < out[3]


@helper
def invert(m, out):
    # adjugate of a row-major 3 x 3: its inverse but for a factor, made so that the greatest entry is 1
    out[0], out[1], out[2] = m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4]
    out[3], out[4], out[5] = m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5]
    out[6], out[7], out[8] = m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]
    most = 0.0
    for i in range(9):
        most = max(most, abs(out[i]))
    if not most > 0.0:
        return False
    if out[0] * m[0] + out[1] * m[3] + out[2] * m[6] < 0.0:
        most = -most
    for i in range(9):
        out[i] /= most
    return True


@helper
def apply(pose, x, y, z, shift, out, column):
    # column (0 .. 2) of a row-major 3 x 3 becomes M (x, y, z), plus the translation where shift is 1
    for row in range(3):
        at = 4 * row
        out[3 * row + column] = pose[at] * x + pose[at + 1] * y + pose[at + 2] * z + shift * pose[at + 3]


@helper
def image_of_plane(pose, calibration, sphere, axes, texel, half, height, camera, out):
    # camera (9,): working memory; half: R / 2 -> out (9,): pixel (x w, y w, w) of texel (u, v, 1) of a plane
    a, b, d = axes[0], axes[1], axes[2]
    apply(pose, texel * a[0], texel * a[1], texel * a[2], 0.0, camera, 0)
    apply(pose, texel * b[0], texel * b[1], texel * b[2], 0.0, camera, 1)
    shift = -half * texel
    x = sphere[0] + shift * (a[0] + b[0]) + height * d[0]
    y = sphere[1] + shift * (a[1] + b[1]) + height * d[1]
    z = sphere[2] + shift * (a[2] + b[2]) + height * d[2]
    apply(pose, x, y, z, 1.0, camera, 2)
    for row in range(3):
        for column in range(3):
            out[3 * row + column] = (
                calibration[row, 0] * camera[column]
                + calibration[row, 1] * camera[3 + column]
                + calibration[row, 2] * camera[6 + column]
            )


@helper
def invert_pose(pose, out):
    # -> out (3, 3): inverse of the left 3 x 3
    det = determinant(pose)
    for column in range(3):
        x, y, z = solve(
            pose, det, 1.0 if column == 0 else 0.0, 1.0 if column == 1 else 0.0, 1.0 if column == 2 else 0.0
        )
        out[0, column], out[1, column], out[2, column] = x, y, z


@helper
def quadratic(moments, x, y, z):
    # mean of (n.v) ** 2 over the normals of a slab, for v = (x, y, z)
    xx, yy = moments[7], moments[8]
    total = xx * x * x + yy * y * y + max(1.0 - xx - yy, 0.0) * z * z
    return total + 2.0 * (moments[9] * x * y + moments[10] * x * z + moments[11] * y * z)


@helper
def normal_stretch(inverse, moments):
    # root mean square length of normals under the inverse transpose of M; 1 / scale of a similarity
    total = 0.0
    for axis in range(3):
        total += quadratic(moments, inverse[0, axis], inverse[1, axis], inverse[2, axis])
    return math.sqrt(max(total, 1e-300))


@helper
def light_gains(inverse, lights, bins, lighting, moments, work, out):
    # what the shade of a whole slab changes by when its lights are not in the middles of their bins -> out (3,)
    exact, wanted, stored = work
    spread = normal_stretch(inverse, moments)
    for n in range(len(lights)):
        for c in range(3):
            exact[n, c] = (
                inverse[c, 0] * lights[n, 0] + inverse[c, 1] * lights[n, 1] + inverse[c, 2] * lights[n, 2]
            ) / spread
    irradiance(moments, 4, exact, lighting[1:], lighting[0], wanted)
    irradiance(moments, 4, bins, lighting[1:], lighting[0], stored)
    for c in range(3):
        out[c] = wanted[c] / stored[c] if stored[c] > 1e-9 else 1.0


@helper
def widening(pose, sphere, focal):
    # by what a part's texels are widened, so that its sphere is at least a pixel wide
    z = pose[8] * sphere[0] + pose[9] * sphere[1] + pose[10] * sphere[2] + pose[11]
    return max(z / (2.0 * stretch(pose) * sphere[3] * focal), 1.0)


@helper
def eye_direction(pose, sphere, out):
    # -> out (3,): unit direction from the middle of a part to the eye, in the part's coordinates
    x, y, z = solve(pose, determinant(pose), -pose[3], -pose[7], -pose[11])
    x, y, z = x - sphere[0], y - sphere[1], z - sphere[2]
    length = math.sqrt(x * x + y * y + z * z)
    out[0], out[1], out[2] = x / length, y / length, z / length


@helper
def thickening(eye, d, moments):
    # optical depth of a slab seen from `eye` over that seen along d, both (3,) unit; moments (12,) of what is seen
    # along d. Surfaces are seen as wide as n.eye instead of n.d, on a slice as narrow as d.eye. The mean of
    # (n.eye / n.d) ** 2 over surfaces is taken from m = mean n and S = mean n n^T: with a = eye across d it is
    # cos^2 + 2 sin cos m.a / m.d + sin^2 S.aa / (m.d)^2, the last term raised by what is seen at a slant and so is
    # seen less: by 16/9 where normals lie in all directions (S.dd = 1/2), not at all where all are d (S.dd = 1)
    cosine = min(eye[0] * d[0] + eye[1] * d[1] + eye[2] * d[2], 1.0)
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    facing = moments[4] * d[0] + moments[5] * d[1] + moments[6] * d[2]
    if sine < 1e-6 or cosine < _LEAST_COSINE or facing < _LEAST_COSINE:
        return 1.0
    x, y, z = (eye[0] - cosine * d[0]) / sine, (eye[1] - cosine * d[1]) / sine, (eye[2] - cosine * d[2]) / sine
    aside = (moments[4] * x + moments[5] * y + moments[6] * z) / facing
    slant = _UNSEEN - (_UNSEEN - 1.0) * (2.0 * quadratic(moments, d[0], d[1], d[2]) - 1.0)
    spread = slant * quadratic(moments, x, y, z) / (facing * facing)
    square = cosine * cosine + 2.0 * sine * cosine * aside + sine * sine * spread
    return min(max(math.sqrt(max(square, 0.0)) / cosine, 0.5), 2.0)


@kernel
def place_slices(draws, poses, tables, slabs, heights, means, view, lights, lighting, numbers, pixels, depths):
    # draws (I, 6) i64: node, choice, first slab, first slice, first shaded texel, key of the lights
    # poses (I, 12) f64; tables: spheres (P, 4), axes (D, 3, 3), resolutions (L,), peaks (I,), stacks (T + 1,) i64
    # slabs (S, 7) i64 as in `shade`; heights (S, 2) f32; means (S, 12) f32
    # view: calibration (3, 3) f64, size (2,) f64; lights (N, 3) f64 in the camera's frame; lighting as in `shade`
    # -> numbers (J, 14) f64, pixels (J, 8) i64, depths (J,) f32; a slice beyond the picture has no columns
    spheres, axes, resolutions, peaks, counts = tables
    calibration, limits = view
    focal = max(calibration[0, 0], calibration[1, 1])
    for i in prange(len(draws)):
        node, level, direction = draws[i, 0], draws[i, 1] >> 16, draws[i, 1] & 0xFFFF
        forward, camera, gains, eye = np.empty(9), np.empty(9), np.empty(3), np.empty(3)
        bins, inverse = np.empty((len(lights), 3)), np.empty((3, 3))
        work = (np.empty((len(lights), 3)), np.empty(3), np.empty(3))
        invert_pose(poses[i], inverse)
        lights_of_key(draws[i, 5], len(lights), BINS, bins)
        half = 0.5 * resolutions[level]
        wider = widening(poses[i], spheres[node], focal)
        texel, share = wider * spheres[node, 3] / half, 1.0 / (wider * wider)
        d = axes[direction, 2]
        eye_direction(poses[i], spheres[node], eye)
        for n in range(counts[i]):
            s, j = draws[i, 2] + n, draws[i, 3] + n
            image_of_plane(
                poses[i], calibration, spheres[node], axes[direction], texel, half, heights[s, 1], camera, forward
            )
            u, v, width, height = slabs[s, 0], slabs[s, 1], slabs[s, 2], slabs[s, 3]
            found = box_of(forward, u, v, width, height, limits, pixels[j]) and invert(forward, numbers[j])
            if not found:
                pixels[j, 0], pixels[j, 1], pixels[j, 2], pixels[j, 3] = 0, 0, 0, 0
            for c in range(3):
                numbers[j, c] += (0.5 - u) * numbers[j, 6 + c]
                numbers[j, 3 + c] += (0.5 - v) * numbers[j, 6 + c]
            light_gains(inverse, lights, bins, lighting, means[s], work, gains)
            for c in range(3):
                numbers[j, 9 + c] = gains[c] * peaks[i] * share
            numbers[j, 12] = share
            numbers[j, 13] = thickening(eye, d, means[s])
            pixels[j, 4] = draws[i, 4] + slabs[s, 5]
            pixels[j, 5], pixels[j, 6], pixels[j, 7] = width, height, 0
            x = spheres[node, 0] + heights[s, 0] * d[0]
            y = spheres[node, 1] + heights[s, 0] * d[1]
            z = spheres[node, 2] + heights[s, 0] * d[2]
            depths[j] = poses[i, 8] * x + poses[i, 9] * y + poses[i, 10] * z + poses[i, 11]
