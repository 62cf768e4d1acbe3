"""Gloss of a whole picture in one pass: position, normal, mirrored direction and colour of every pixel.

Rows of pixels are gathered one by one, mirrored in a loop without branches, followed through the grid
(:mod:`ibrpipe.core.reflection.voxels`), and coloured. The model is that of :mod:`ibrpipe.core.reflection.model`; here
tables and colours are linear light.

Packed arguments: ``surface`` (records (P, 8) i32 as scene.records; normals (S, 3) f32; colors (S, 4) f32, fourth 0 =
unknown; weights (S, L) f32 or (0, L); active (F,) bool: fields that mirror); ``lights`` (tables (L, M, 4) f32 padded,
law (2 + L,) f64: damping, -, f_l);
``grid``, ``shapes``: see voxels.
"""

import math

import numpy as np
from numba import prange

from ibrpipe.core.jit import exact_kernel, fused_exact
from ibrpipe.core.reflection.directions import table_cell
from ibrpipe.core.reflection.model import CHANNELS, CORNERS, TABLES, mirror
from ibrpipe.core.reflection.voxels import follow_rays

#: rows that are drawn together
ROWS = 16
#: rows of working memory, float32: from eye to point (later the mirrored direction), normal, position in the cell of
#: the table, s, then weights of the tables
DX, DY, DZ, NX, NY, NZ, FX, FY, S, SHARE = range(10)
#: and int32: column, cell of the table
AT, CELL = range(2)
ONE = np.float32(1.0)


@fused_exact
def weigh_corners(x, y, z, patch, records, poses, out):
    """Fill out (4,) with the weights of a patch's corners at a point, 0 where there is no sample; False if none is."""
    f = records[patch, 2]
    q = poses[f, 3, 0] * x + poses[f, 3, 1] * y + poses[f, 3, 2] * z + poses[f, 3, 3]
    u = (poses[f, 0, 0] * x + poses[f, 0, 1] * y + poses[f, 0, 2] * z + poses[f, 0, 3]) / q - records[patch, 0]
    v = (poses[f, 1, 0] * x + poses[f, 1, 1] * y + poses[f, 1, 2] * z + poses[f, 1, 3]) / q - records[patch, 1]
    u, v = min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)
    out[0] = (1.0 - u) * (1.0 - v) if records[patch, 4] >= 0 else 0.0
    out[1] = u * (1.0 - v) if records[patch, 5] >= 0 else 0.0
    out[2] = (1.0 - u) * v if records[patch, 6] >= 0 else 0.0
    out[3] = u * v if records[patch, 7] >= 0 else 0.0
    return out[0] + out[1] + out[2] + out[3] > 0.0


@fused_exact
def mean_normal(normals, records, patch, weights):
    """Sum of the normals of a position between samples, by weight; NaN where one is not known."""
    x, y, z = 0.0, 0.0, 0.0
    for c in range(CORNERS):
        if weights[c] > 0.0:
            sample = records[patch, 4 + c]
            x += weights[c] * normals[sample, 0]
            y += weights[c] * normals[sample, 1]
            z += weights[c] * normals[sample, 2]
    return x, y, z


@fused_exact
def mean_share(shares, colors, table, records, patch, weights):
    """How much of a table a position between samples of known colour shows; 1 where the tables are not weighed."""
    if len(shares) == 0:
        return 1.0
    total, share = 0.0, 0.0
    for c in range(CORNERS):
        if weights[c] > 0.0:
            sample = records[patch, 4 + c]
            weight = weights[c] if colors[sample, 3] > 0.0 else 0.0
            total += weight
            share += weight * shares[sample, table]
    return share / total if total > 0.0 else 0.0


@fused_exact
def pixel_ray(world_from_pixel, px, py):
    """The ray through a pixel, one unit of depth long."""
    return (
        px * world_from_pixel[0, 0] + py * world_from_pixel[0, 1] + world_from_pixel[0, 2],
        px * world_from_pixel[1, 0] + py * world_from_pixel[1, 1] + world_from_pixel[1, 2],
        px * world_from_pixel[2, 0] + py * world_from_pixel[2, 1] + world_from_pixel[2, 2],
    )


@fused_exact
def gather_row(y, picture, view, surface, poses, weights, out, out_marks, out_rays):
    """List the pixels of a row that mirror; return how many."""
    depth, ids, known = picture
    records, normals, colors, shares, active = surface
    world_from_pixel, eye, rows, columns = view
    count = 0
    for x in range(depth.shape[1]):
        far, patch = float(depth[y, x]), np.int64(ids[y, x])
        if not (far < np.inf and known[y, x] > 0.0 and patch < len(records)):
            continue
        if not active[records[patch, 2]]:
            continue
        wx, wy, wz = pixel_ray(world_from_pixel, rows[y, 0] + columns[x, 0], rows[y, 1] + columns[x, 1])
        wx, wy, wz = far * wx, far * wy, far * wz
        ax, ay, az = eye[0] + wx, eye[1] + wy, eye[2] + wz
        if not weigh_corners(ax, ay, az, patch, records, poses, weights):
            continue
        nx, ny, nz = mean_normal(normals, records, patch, weights)
        if not nx * nx + ny * ny + nz * nz > 0.0:
            continue
        out[DX, count], out[DY, count], out[DZ, count] = wx, wy, wz
        out[NX, count], out[NY, count], out[NZ, count] = nx, ny, nz
        for table in range(shares.shape[1]):
            out[SHARE + table, count] = mean_share(shares, colors, table, records, patch, weights)
        out_marks[AT, count] = x
        out_rays[count, 0], out_rays[count, 1], out_rays[count, 2] = ax, ay, az
        count += 1
    return count


@fused_exact
def mirror_row(count, size, out, out_marks):
    """Turn views and normals into mirrored directions (in their stead), positions in the table, and s."""
    for k in range(count):
        wx, wy, wz, nx, ny, nz = out[DX, k], out[DY, k], out[DZ, k], out[NX, k], out[NY, k], out[NZ, k]
        back, unit = -ONE / math.sqrt(wx * wx + wy * wy + wz * wz), ONE / math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx * unit, ny * unit, nz * unit
        rx, ry, rz, out[S, k] = mirror(nx, ny, nz, wx * back, wy * back, wz * back)
        out[DX, k], out[DY, k], out[DZ, k], out[NX, k], out[NY, k], out[NZ, k] = rx, ry, rz, nx, ny, nz
        out_marks[CELL, k], out[FX, k], out[FY, k] = table_cell(rx, ry, rz, size)


@fused_exact
def start_row(count, lift, row, rays):
    """Turn poses of pixels into starts of reflected rays, and set the directions."""
    for k in range(count):
        for axis in range(3):
            direction = float(row[DX + axis, k])
            rays[k, axis] += lift[0] * row[NX + axis, k] + lift[1] * direction
            rays[k, 3 + axis] = direction


@fused_exact
def light_row(y, color, count, lift, surface, lights, poses, weights, row, marks, rays, met):
    """Put over the colours of pixels whose rays meet a patch the light of what they meet; return how many."""
    # met: (distances, patches) of what the rays meet; these pixels' cells become -1
    records, normals, colors, shares, _ = surface
    tables, law = lights
    distances, patches = met
    width, many = int(math.sqrt(tables.shape[1]) + 0.5), 0
    for k in range(count):
        patch = patches[k]
        if patch < 0:
            continue
        many += 1
        wx, wy, wz, t = rays[k, 3], rays[k, 4], rays[k, 5], distances[k]
        ex, ey, ez = rays[k, 0] + t * wx, rays[k, 1] + t * wy, rays[k, 2] + t * wz
        # towards the point that mirrors
        t += lift[1]
        vx, vy, vz = -lift[0] * row[NX, k] - t * wx, -lift[0] * row[NY, k] - t * wy, -lift[0] * row[NZ, k] - t * wz
        total, red, green, blue, s, gloss = 0.0, 0.0, 0.0, 0.0, 0.0, False
        cell, fx, fy = np.int32(0), 0.0, 0.0
        if weigh_corners(ex, ey, ez, patch, records, poses, weights):
            for c in range(CORNERS):
                if weights[c] > 0.0:
                    sample = records[patch, 4 + c]
                    weight = weights[c] if colors[sample, 3] > 0.0 else 0.0
                    total += weight
                    red += weight * colors[sample, 0]
                    green += weight * colors[sample, 1]
                    blue += weight * colors[sample, 2]
            nx, ny, nz = mean_normal(normals, records, patch, weights)
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            gloss = total > 0.0 and length > 0.0
            if gloss:
                nx, ny, nz, back = nx / length, ny / length, nz / length, 1.0 / math.sqrt(vx * vx + vy * vy + vz * vz)
                rx, ry, rz, s = mirror(nx, ny, nz, vx * back, vy * back, vz * back)
                cell, fx, fy = table_cell(rx, ry, rz, width - 2)
        scale = 1.0 / total if total > 0.0 else 0.0
        share, own = 0.0, float(row[S, k])
        for table in range(tables.shape[0]):
            share += row[SHARE + table, k] * (law[2 + table] + (1.0 - law[2 + table]) * own)
        for channel in range(CHANNELS):
            light = (red if channel == 0 else green if channel == 1 else blue) * scale
            if gloss:
                light *= 1.0 - law[0] * s
                for table in range(tables.shape[0]):
                    f = law[2 + table]
                    upper = (1.0 - fx) * tables[table, cell, channel] + fx * tables[table, cell + 1, channel]
                    below = cell + width
                    lower = (1.0 - fx) * tables[table, below, channel] + fx * tables[table, below + 1, channel]
                    weight = mean_share(shares, colors, table, records, patch, weights) * (f + (1.0 - f) * s)
                    light += weight * ((1.0 - fy) * upper + fy * lower)
            at = marks[AT, k]
            color[y, at, channel] = (1.0 - law[0] * own) * color[y, at, channel] + share * min(light, lift[2])
        marks[CELL, k] = -1
    return many


@fused_exact
def color_row(y, count, color, lights, row, marks):
    """Put gloss over the colours of listed pixels whose rays are free."""
    tables, law = lights
    width = np.int32(math.sqrt(tables.shape[1]) + 0.5)
    damping = np.float32(law[0])
    for k in range(count):
        x, cell, fx, fy, s = marks[AT, k], marks[CELL, k], row[FX, k], row[FY, k], row[S, k]
        if cell < 0:
            continue
        left, above = ONE - fx, ONE - fy
        a, b, c, e = left * above, fx * above, left * fy, fx * fy
        rest = ONE - damping * s
        red, green, blue = rest * color[y, x, 0], rest * color[y, x, 1], rest * color[y, x, 2]
        for table in range(tables.shape[0]):
            f = np.float32(law[2 + table])
            share = row[SHARE + table, k] * (f + (ONE - f) * s)
            red += share * (
                a * tables[table, cell, 0] + b * tables[table, cell + 1, 0]
                + c * tables[table, cell + width, 0] + e * tables[table, cell + width + 1, 0]
            )  # fmt: skip
            green += share * (
                a * tables[table, cell, 1] + b * tables[table, cell + 1, 1]
                + c * tables[table, cell + width, 1] + e * tables[table, cell + width + 1, 1]
            )  # fmt: skip
            blue += share * (
                a * tables[table, cell, 2] + b * tables[table, cell + 1, 2]
                + c * tables[table, cell + width, 2] + e * tables[table, cell + width + 1, 2]
            )  # fmt: skip
        color[y, x, 0], color[y, x, 1], color[y, x, 2] = red, green, blue


@exact_kernel
def draw_gloss(picture, color, view, surface, lights, grid, shapes, lift, order, out_counts):
    """Put gloss over color (H, W, 3) f32; out_counts (H, 2) i64: pixels that mirror, and whose rays meet a front."""
    # picture: depth (H, W) f32, inf = none; ids (H, W) u32; known (H, W) f32; view = (world from pixel (3, 3), centre
    # (3,), rows (H, 2), columns (W, 2)) f64: ray (y, x) passes through rows[y] + columns[x] of the camera's picture
    # lift (3,) f64: how far above the surface, and along its direction, a reflected ray starts; brightest light that
    # the object mirrors of itself; order (ceil(H / ROWS),) i64: in which rows are drawn
    rows, columns = color.shape[:2]
    tables, poses = lights[0], shapes[0]
    size = np.int32(math.sqrt(tables.shape[1]) + 0.5) - np.int32(2)
    for each in prange(len(order)):
        row, marks = np.empty((SHARE + TABLES, columns), np.float32), np.empty((2, columns), np.int32)
        weights, rays = np.empty(CORNERS), np.empty((columns, 6))
        distances, patches = np.empty(columns), np.empty(columns, np.int64)
        for y in range(order[each] * ROWS, min(order[each] * ROWS + ROWS, rows)):
            count = gather_row(y, picture, view, surface, poses, weights, row, marks, rays)
            mirror_row(count, size, row, marks)
            start_row(count, lift, row, rays)
            follow_rays(rays, 0, count, grid, shapes, distances, patches)
            out_counts[y, 0] = count
            out_counts[y, 1] = light_row(
                y, color, count, lift, surface, lights, poses, weights, row, marks, rays, (distances, patches)
            )
            color_row(y, count, color, lights, row, marks)
