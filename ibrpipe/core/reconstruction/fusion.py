"""Which pixels of a depth map other depth maps confirm, and the points they make together.

Source: schoenberger2016, sec. 4.4 (consistency as a graph of pixels), here star-shaped: a pixel against its view's
neighbours. Departures: a neighbour's depth is carried along its own tangent plane to the pixel's ray instead of being
taken at the nearest pixel, and neighbours that look through the point count against it.

Maps are packed: map m owns pixels ``starts[m]`` to ``starts[m + 1]``, row-major, of size ``sizes[m] = (H, W)``. Map 0
is the view itself, the others are its neighbours. z: depth along the own camera's axis; X = center + z * ray.

Kernels take the maps' cameras as the tuple ``cameras``: starts (M + 1,) i64; sizes (M, 2) i64; projection (M, 3, 4)
f64, pixels from world; rays (M, 3, 3) f64, world directions of camera depth 1 from pixels; centers (M, 3) f64.
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel

#: indices in the settings array
PIXELS, RELATIVE, COSINE, LEAST = 0, 1, 2, 3


@helper
def project(projection, m, px, py, pz):
    """Return pixel x, y and depth of a world point in map m."""
    x = projection[m, 0, 0] * px + projection[m, 0, 1] * py + projection[m, 0, 2] * pz + projection[m, 0, 3]
    y = projection[m, 1, 0] * px + projection[m, 1, 1] * py + projection[m, 1, 2] * pz + projection[m, 1, 3]
    z = projection[m, 2, 0] * px + projection[m, 2, 1] * py + projection[m, 2, 2] * pz + projection[m, 2, 3]
    if not z > 0.0:
        return -1.0, -1.0, -1.0
    return x / z, y / z, z


@helper
def pixel_of(x, y, starts, sizes, m):
    """Return the packed index of the pixel that holds (x, y), -1 outside."""
    if not (x >= 0.0 and y >= 0.0 and x < sizes[m, 1] and y < sizes[m, 0]):
        return -1
    return starts[m] + int(y) * sizes[m, 1] + int(x)


@helper
def ray_of(rays, m, x, y):
    """Return the world direction, of camera depth 1, of point (x, y) of the picture in map m."""
    return (
        rays[m, 0, 0] * x + rays[m, 0, 1] * y + rays[m, 0, 2],
        rays[m, 1, 0] * x + rays[m, 1, 1] * y + rays[m, 1, 2],
        rays[m, 2, 0] * x + rays[m, 2, 1] * y + rays[m, 2, 2],
    )


@helper
def depth_on_plane(m, index, cameras, depth, normal, start, direction):
    """Return where the ray start + z direction meets the tangent plane of map m's packed pixel; NaN where too flat."""
    starts, sizes, _, rays, centers = cameras
    (ox, oy, oz), (dx, dy, dz) = start, direction
    local = index - starts[m]
    x, y = local % sizes[m, 1] + 0.5, local // sizes[m, 1] + 0.5
    rx, ry, rz = ray_of(rays, m, x, y)
    d = depth[index]
    nx, ny, nz = normal[index, 0], normal[index, 1], normal[index, 2]
    facing = nx * dx + ny * dy + nz * dz
    if abs(facing) < 0.1 * math.sqrt(dx * dx + dy * dy + dz * dz):
        return np.nan
    ahead = nx * (centers[m, 0] + d * rx - ox) + ny * (centers[m, 1] + d * ry - oy) + nz * (centers[m, 2] + d * rz - oz)
    return ahead / facing


@kernel
def fuse_view(depth, normal, confidence, cameras, settings, used, out_mean, out_normal, out_votes):
    """Confirm every pixel of map 0 by the other maps."""
    # depth (T,) f32, scene units along camera z, 0 = unknown; normal (T, 3) f32 world; confidence (T,) f32 0..1
    # cameras: see above
    # settings (4,) f64: most disparity in pixels, most relative depth, least cosine of normals, least votes
    # used (T,) u8: set to 1 at the neighbours' pixels that a confirmed pixel stands for (only ever set, never cleared)
    # out_mean (H, W, 2) f32: mean depth and confidence; out_normal (H, W, 3) f32 mean, unit
    # out_votes (H, W, 2) i32: maps that agree, itself included, and maps that look through the point
    starts, sizes, projection, rays, centers = cameras
    height, width = sizes[0, 0], sizes[0, 1]
    for row in prange(height):
        packed = starts, sizes, projection, rays, centers
        for column in range(width):
            index = starts[0] + row * width + column
            z = float(depth[index])
            out_votes[row, column, 0], out_votes[row, column, 1] = 0, 0
            out_mean[row, column, 0], out_mean[row, column, 1] = 0.0, 0.0
            for c in range(3):
                out_normal[row, column, c] = normal[index, c]
            if not z > 0.0:
                continue
            direction = ray_of(rays, 0, column + 0.5, row + 0.5)
            weight = max(float(confidence[index]), 1e-3)
            total, mean, unsure = weight, weight * z, 1.0 - min(float(confidence[index]), 0.999)
            nx, ny, nz = weight * normal[index, 0], weight * normal[index, 1], weight * normal[index, 2]
            votes, through = 1, 0
            for m in range(1, sizes.shape[0]):
                verdict, other, there = judge(m, z, index, direction, depth, normal, packed, settings)
                if verdict < 0:
                    through += 1
                elif verdict > 0:
                    votes += 1
                    weight = max(float(confidence[there]), 1e-3)
                    total += weight
                    mean += weight * other
                    unsure *= 1.0 - min(float(confidence[there]), 0.999)
                    nx += weight * normal[there, 0]
                    ny += weight * normal[there, 1]
                    nz += weight * normal[there, 2]
            out_votes[row, column, 0], out_votes[row, column, 1] = votes, through
            out_mean[row, column, 0] = mean / total
            out_mean[row, column, 1] = (1.0 - unsure) * votes / (votes + through)
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            if length > 0.0:
                out_normal[row, column, 0] = nx / length
                out_normal[row, column, 1] = ny / length
                out_normal[row, column, 2] = nz / length
            if votes >= settings[LEAST] and votes > through and used[index] == 0:
                for m in range(1, sizes.shape[0]):
                    verdict, other, there = judge(m, z, index, direction, depth, normal, packed, settings)
                    if verdict > 0:
                        used[there] = 1


@helper
def judge(m, z, own, direction, depth, normal, cameras, settings):
    """Ask map m about the point at depth z along a ray: 1 agrees, -1 looks through, 0 cannot say; its depth, pixel."""
    starts, sizes, projection, _, centers = cameras
    ox, oy, oz = centers[0, 0], centers[0, 1], centers[0, 2]
    dx, dy, dz = direction
    x, y, seen = project(projection, m, ox + z * dx, oy + z * dy, oz + z * dz)
    there = pixel_of(x, y, starts, sizes, m)
    if there < 0 or not depth[there] > 0.0:
        return 0, 0.0, -1
    other = depth_on_plane(m, there, cameras, depth, normal, (ox, oy, oz), direction)
    if not other > 0.0:
        other = z * depth[there] / seen
    bx, by, _ = project(projection, m, ox + other * dx, oy + other * dy, oz + other * dz)
    off = math.sqrt((bx - x) * (bx - x) + (by - y) * (by - y))
    apart = abs(depth[there] - seen) / seen
    if off <= settings[PIXELS] and abs(other - z) <= settings[RELATIVE] * z:
        same = normal[own, 0] * normal[there, 0] + normal[own, 1] * normal[there, 1] + normal[own, 2] * normal[there, 2]
        return (1 if same >= settings[COSINE] else 0), other, there
    deeper = depth[there] > seen
    return (-1 if deeper and apart > settings[RELATIVE] and off > 2.0 * settings[PIXELS] else 0), other, there
