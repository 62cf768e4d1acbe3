"""Signed distances on blocks of 8 x 8 x 8 voxels, averaged over depth maps, and bounds from silhouettes.

Source: curless1996 (weighted running averages of truncated distances, with space carving); distances are taken to the
tangent plane of the pixel, not along the ray. Block b covers voxels ``corners[b]`` to ``corners[b] + 7``; voxel
(i, j, k) stands at ``origin + step * (i, j, k)``. Within a block voxel (i, j, k) is entry ``64 i + 8 j + k``.
Positive = outside, in front of the surface.
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import helper, kernel
from ibrpipe.core.reconstruction.fusion import pixel_of, project, ray_of

SIDE = 8


@helper
def outline_at(distance, starts, sizes, m, x, y):
    """Return the bilinear distance to the outline at point (x, y) of map m, inside the picture."""
    j0 = min(max(int(x - 0.5), 0), max(sizes[m, 1] - 2, 0))
    i0 = min(max(int(y - 0.5), 0), max(sizes[m, 0] - 2, 0))
    j1, i1 = min(j0 + 1, sizes[m, 1] - 1), min(i0 + 1, sizes[m, 0] - 1)
    fx, fy = min(max(x - 0.5 - j0, 0.0), 1.0), min(max(y - 0.5 - i0, 0.0), 1.0)
    up, down = starts[m] + i0 * sizes[m, 1], starts[m] + i1 * sizes[m, 1]
    top = (1.0 - fx) * distance[up + j0] + fx * distance[up + j1]
    low = (1.0 - fx) * distance[down + j0] + fx * distance[down + j1]
    return (1.0 - fy) * top + fy * low


@helper
def homogeneous(projection, m, px, py, pz):
    """Return the homogeneous pixel of a world point in map m."""
    return (
        projection[m, 0, 0] * px + projection[m, 0, 1] * py + projection[m, 0, 2] * pz + projection[m, 0, 3],
        projection[m, 1, 0] * px + projection[m, 1, 1] * py + projection[m, 1, 2] * pz + projection[m, 1, 3],
        projection[m, 2, 0] * px + projection[m, 2, 1] * py + projection[m, 2, 2] * pz + projection[m, 2, 3],
    )


@helper
def note_bound(out_bound, n, outside):
    """Keep the two greatest distances outside an outline: one wrong mask then cuts nothing away."""
    if outside > out_bound[n, 0]:
        out_bound[n, 1] = out_bound[n, 0]
        out_bound[n, 0] = outside
    elif outside > out_bound[n, 1]:
        out_bound[n, 1] = outside


@kernel
def integrate(corners, lattice, depth, normal, weight, outline, cameras, limits, out_sum, out_free, out_bound):
    """Add the distances that a few packed maps see, and bound the voxels by their outlines."""
    # corners (B, 3) i32; lattice (4,) f64: origin and step of the voxels
    # depth (T,) f32, 0 = unknown; normal (T, 3) f32 world; weight (T,) f32
    # cameras: see `fusion`
    # outline (T,) f32: pixels to the outline, positive outside, NaN = cannot say; (0,) without masks
    # limits (1 + M,) f64: truncation in scene units, focal lengths in pixels
    # out_sum (B, 512, 2) f32: sums of weight * distance / truncation, and of weight, near surfaces
    # out_free (B, 512) f32: sum of the weights of rays that pass far in front of a surface
    # out_bound (B * 512, 2) f32: the two greatest distances outside an outline, scene units; (0, 2) without masks
    starts, sizes, projection, rays, centers = cameras
    for b in prange(corners.shape[0]):
        for m in range(sizes.shape[0]):
            step = lattice[3]
            ax, ay, az = step * projection[m, 0, 2], step * projection[m, 1, 2], step * projection[m, 2, 2]
            px, py, pz, hx, hy, hz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for v in range(SIDE * SIDE * SIDE):
                if v % SIDE == 0:
                    px = lattice[0] + step * (corners[b, 0] + v // 64)
                    py = lattice[1] + step * (corners[b, 1] + v // 8 % 8)
                    pz = lattice[2] + step * corners[b, 2]
                    hx, hy, hz = homogeneous(projection, m, px, py, pz)
                else:
                    pz += step
                    hx, hy, hz = hx + ax, hy + ay, hz + az
                if not hz > 0.0:
                    continue
                x, y = hx / hz, hy / hz
                index = pixel_of(x, y, starts, sizes, m)
                if index < 0:
                    continue
                if outline.shape[0] > 0:
                    outside = outline_at(outline, starts, sizes, m, x, y) * hz / limits[1 + m]
                    if not np.isnan(outside):
                        note_bound(out_bound, b * 512 + v, outside)
                d = depth[index]
                if not d > 0.0 or hz > d + limits[0]:
                    continue
                local = index - starts[m]
                rx, ry, rz = ray_of(rays, m, local % sizes[m, 1] + 0.5, local // sizes[m, 1] + 0.5)
                ahead = (d - hz) * math.sqrt(rx * rx + ry * ry + rz * rz)
                if ahead < -limits[0]:
                    continue
                if ahead > 2.0 * limits[0]:
                    out_free[b, v] += weight[index]
                    continue
                away = (
                    normal[index, 0] * (px - centers[m, 0] - d * rx)
                    + normal[index, 1] * (py - centers[m, 1] - d * ry)
                    + normal[index, 2] * (pz - centers[m, 2] - d * rz)
                )
                out_sum[b, v, 0] += weight[index] * max(min(away, limits[0]), -limits[0]) / limits[0]
                out_sum[b, v, 1] += weight[index]


@kernel
def silhouettes(points, outline, starts, sizes, projection, focal, whole, out_bound, out_count):
    """Bound points by the outlines of a few photos."""
    # points (N, 3) f64 world; outline (T,) f32 as in integrate; focal (M,) f64 pixels
    # whole (M,) u8: all of the object is in the picture, so that points off it lie outside; else it cannot say
    # out_bound (N, 2) f32: the two greatest distances outside any outline so far, scene units; start at -inf
    # out_count (N,) i32: photos that can say something of the point
    for n in prange(points.shape[0]):
        for m in range(sizes.shape[0]):
            x, y, z = project(projection, m, points[n, 0], points[n, 1], points[n, 2])
            if pixel_of(x, y, starts, sizes, m) >= 0:
                outside = outline_at(outline, starts, sizes, m, x, y) * z / focal[m]
            elif whole[m] == 0:
                continue
            elif z <= 0.0:
                outside = np.inf
            else:
                cx, cy = min(max(x, 0.0), float(sizes[m, 1])), min(max(y, 0.0), float(sizes[m, 0]))
                beyond = math.sqrt((x - cx) * (x - cx) + (y - cy) * (y - cy))
                outside = (outline_at(outline, starts, sizes, m, cx, cy) + beyond) * z / focal[m]
            if not np.isnan(outside):
                out_count[n] += 1
                note_bound(out_bound, n, outside)


@kernel
def observe(points, depth, confidence, starts, sizes, projection, tolerance, out_seen, out_through, out_confidence):
    """Count the maps that show a surface at points, and those that look through them."""
    # points (N, 3) f64; tolerance (N,) f64 scene units; out_seen, out_through (N,) i32; out_confidence (N,) f32: best
    for n in prange(points.shape[0]):
        for m in range(sizes.shape[0]):
            x, y, z = project(projection, m, points[n, 0], points[n, 1], points[n, 2])
            index = pixel_of(x, y, starts, sizes, m)
            if index < 0 or not depth[index] > 0.0:
                continue
            gap = depth[index] - z
            if abs(gap) <= tolerance[n]:
                out_seen[n] += 1
                out_confidence[n] = max(out_confidence[n], confidence[index])
            elif gap > 3.0 * tolerance[n]:
                out_through[n] += 1
