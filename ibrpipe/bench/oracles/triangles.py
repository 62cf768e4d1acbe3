"""Rays against triangles one by one, in float64."""

from __future__ import annotations

from numba import prange

from ibrpipe.core.jit import exact_kernel


@exact_kernel
def nearest_triangles(rays, corners, boxes, near, depth, face):
    # rays (N, 3) f64 from 0, z = 1; corners (F, 3, 3) f64; boxes (F, 4) f64 of x / z and y / z
    # -> depth (N,) f64 of the first hit beyond `near`, face (N,) i64; both are kept where nothing nearer is hit
    for n in prange(len(rays)):
        dx, dy, dz = rays[n, 0], rays[n, 1], rays[n, 2]
        for f in range(len(corners)):
            if dx < boxes[f, 0] or dx > boxes[f, 1] or dy < boxes[f, 2] or dy > boxes[f, 3]:
                continue
            ax, ay, az = corners[f, 0, 0], corners[f, 0, 1], corners[f, 0, 2]
            bx, by, bz = corners[f, 1, 0] - ax, corners[f, 1, 1] - ay, corners[f, 1, 2] - az
            cx, cy, cz = corners[f, 2, 0] - ax, corners[f, 2, 1] - ay, corners[f, 2, 2] - az
            px, py, pz = dy * cz - dz * cy, dz * cx - dx * cz, dx * cy - dy * cx
            det = bx * px + by * py + bz * pz
            if det == 0.0:
                continue
            u = -(ax * px + ay * py + az * pz) / det
            if u < 0.0 or u > 1.0:
                continue
            qx, qy, qz = az * by - ay * bz, ax * bz - az * bx, ay * bx - ax * by
            v = (dx * qx + dy * qy + dz * qz) / det
            if v < 0.0 or u + v > 1.0:
                continue
            t = (cx * qx + cy * qy + cz * qz) / det
            if near < t < depth[n]:
                depth[n], face[n] = t, f
