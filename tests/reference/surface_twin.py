"""Plain twins of the kernels of fusion, volume and surface nets: one pixel, voxel or cell at a time, in NumPy."""

from __future__ import annotations

import itertools

import numpy as np


def _project(camera, point):
    """Pixel place and depth of a world point."""
    x, y, z = camera.K @ (camera.R @ point + camera.t)
    return (x / z, y / z, z) if z > 0 else None


def _pixel(maps, m, point):
    """(row, column, x, y, depth of the point) of the pixel of map m that holds a point; None outside."""
    found = _project(maps[m].camera, point)
    if found is None:
        return None
    x, y, z = found
    height, width = maps[m].depth.shape
    if not (0 <= x < width and 0 <= y < height):
        return None
    return int(y), int(x), x, y, z


def _at(camera, row, column, z):
    """World point of a pixel's centre at a depth."""
    return camera.center + z * (camera.world_from_pixel @ (column + 0.5, row + 0.5, 1.0))


def judge(maps, m, row, column, z, rules):
    """What map m says of map 0's pixel at depth z."""
    own, other = maps[0], maps[m]
    ray = own.camera.world_from_pixel @ (column + 0.5, row + 0.5, 1.0)
    point = own.camera.center + z * ray
    hit = _pixel(maps, m, point)
    if hit is None or not other.depth[hit[:2]] > 0:
        return 0, 0.0, None
    there, (x, y, seen) = hit[:2], hit[2:]
    normal, depth = other.normal[there].astype(float), float(other.depth[there])
    anchor = _at(other.camera, *there, depth)
    facing = normal @ ray
    carried = np.nan
    if abs(facing) >= 0.1 * np.linalg.norm(ray):
        carried = normal @ (anchor - own.camera.center) / facing
    if not carried > 0:
        carried = z * depth / seen
    back = _project(other.camera, own.camera.center + carried * ray) or (-1.0, -1.0, -1.0)
    off = np.hypot(back[0] - x, back[1] - y)
    if off <= rules.pixels and abs(carried - z) <= rules.relative * z:
        alike = own.normal[row, column].astype(float) @ normal >= np.cos(np.radians(rules.degrees))
        return int(alike), carried, there
    beyond = depth > seen and (depth - seen) / seen > rules.relative and off > 2 * rules.pixels
    return -int(beyond), carried, there


def fuse_view(maps, rules, used):
    """Mean (H, W, 2), normal (H, W, 3) and votes (H, W, 2) of map 0; marks what its pixels stand for in `used`."""
    own = maps[0]
    shape = own.depth.shape
    mean, normal, votes = np.zeros((*shape, 2)), own.normal.astype(float), np.zeros((*shape, 2), int)
    for row, column in np.ndindex(shape):
        z = float(own.depth[row, column])
        if not z > 0:
            continue
        weights, depths, normals, sure = [max(float(own.confidence[row, column]), 1e-3)], [z], [normal[row, column]], []
        sure.append(min(float(own.confidence[row, column]), 0.999))
        through, agreed = 0, []
        for m in range(1, len(maps)):
            verdict, carried, there = judge(maps, m, row, column, z, rules)
            through += verdict < 0
            if verdict > 0:
                agreed.append((m, there))
                weights.append(max(float(maps[m].confidence[there]), 1e-3))
                sure.append(min(float(maps[m].confidence[there]), 0.999))
                depths.append(carried)
                normals.append(maps[m].normal[there].astype(float))
        count = len(depths)
        votes[row, column] = count, through
        mean[row, column, 0] = np.average(depths, weights=weights)
        mean[row, column, 1] = (1 - np.prod(1 - np.array(sure))) * count / (count + through)
        total = np.average(normals, axis=0, weights=weights)
        if np.linalg.norm(total) > 0:
            normal[row, column] = total / np.linalg.norm(total)
        if count >= rules.votes and count > through and not used[0][row, column]:
            for m, there in agreed:
                used[m][there] = 1
    return mean, normal, votes


def integrate(points, maps, weights, truncation):
    """(sum, weight, free weight) of the maps' distances at world points (N, 3)."""
    out = np.zeros((len(points), 3))
    for n, m in itertools.product(range(len(points)), range(len(maps))):
        hit = _pixel(maps, m, points[n])
        if hit is None or not maps[m].depth[hit[:2]] > 0:
            continue
        there, z, d = hit[:2], hit[4], float(maps[m].depth[hit[:2]])
        camera = maps[m].camera
        ray = camera.world_from_pixel @ (there[1] + 0.5, there[0] + 0.5, 1.0)
        ahead = (d - z) * np.linalg.norm(ray)
        if ahead < -truncation or z > d + truncation:
            continue
        weight = weights[m][there]
        if ahead > 2 * truncation:
            out[n, 2] += weight
            continue
        away = maps[m].normal[there].astype(float) @ (points[n] - _at(camera, *there, d))
        out[n, :2] += weight * np.clip(away / truncation, -1, 1), weight
    return out


def outline_bounds(points, cameras, outlines):
    """The two greatest distances outside (N, 2) and the number of pictures that hold each point (N,)."""
    bound, count = np.full((len(points), 2), -np.inf), np.zeros(len(points), int)
    for n in range(len(points)):
        found = []
        for camera, distance in zip(cameras, outlines):
            hit = _project(camera, points[n])
            if hit is None or not (0 <= hit[0] < camera.width and 0 <= hit[1] < camera.height):
                continue
            x = np.clip(hit[0] - 0.5, 0, camera.width - 1)
            y = np.clip(hit[1] - 0.5, 0, camera.height - 1)
            j, i = min(int(x), max(camera.width - 2, 0)), min(int(y), max(camera.height - 2, 0))
            j1, i1 = min(j + 1, camera.width - 1), min(i + 1, camera.height - 1)
            top = (1 - (x - j)) * distance[i, j] + (x - j) * distance[i, j1]
            low = (1 - (x - j)) * distance[i1, j] + (x - j) * distance[i1, j1]
            value = (top + (y - i) * (low - top)) * hit[2] / camera.K[0, 0]
            if not np.isnan(value):
                found.append(value)
        count[n] = len(found)
        bound[n, : min(len(found), 2)] = sorted(found, reverse=True)[:2]
    return bound, count


def observe(points, maps, tolerance):
    """How many maps show a surface at points, and how many look through."""
    seen, through = np.zeros(len(points), int), np.zeros(len(points), int)
    for n, m in itertools.product(range(len(points)), range(len(maps))):
        hit = _pixel(maps, m, points[n])
        if hit is None or not maps[m].depth[hit[:2]] > 0:
            continue
        gap = float(maps[m].depth[hit[:2]]) - hit[4]
        seen[n] += abs(gap) <= tolerance[n]
        through[n] += gap > 3 * tolerance[n]
    return seen, through


def surface_net(value):
    """Vertices (V, 3) in voxels and faces (F, 3) of the zero surface of a dense (X, Y, Z) array, NaN = unknown."""
    numbers, places = {}, []
    for cell in itertools.product(*(range(size - 1) for size in value.shape)):
        corners = value[tuple(slice(c, c + 2) for c in cell)]
        if np.isnan(corners).any() or (corners < 0).all() or (corners >= 0).all():
            continue
        crossings = []
        for corner in itertools.product((0, 1), repeat=3):
            for axis in range(3):
                other = list(corner)
                other[axis] += 1
                if other[axis] > 1:
                    continue
                near, far = corners[corner], corners[tuple(other)]
                if (near < 0) != (far < 0):
                    place = np.array(corner, float)
                    place[axis] += near / (near - far)
                    crossings.append(place)
        numbers[cell] = len(places)
        places.append(np.array(cell) + np.mean(crossings, axis=0))
    faces = []
    for voxel in np.ndindex(value.shape):
        for axis in range(3):
            other = list(voxel)
            other[axis] += 1
            if other[axis] >= value.shape[axis]:
                continue
            near, far = value[voxel], value[tuple(other)]
            if np.isnan(near) or np.isnan(far) or (near < 0) == (far < 0):
                continue
            u, w = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
            ring = [tuple(np.array(voxel) - a * u - b * w) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
            if not all(cell in numbers for cell in ring):
                continue
            p, q, r, s = (numbers[cell] for cell in ring)
            faces += [(p, q, r), (p, r, s)] if near < 0 else [(p, r, q), (p, s, r)]
    return np.array(places).reshape(-1, 3), np.array(faces, int).reshape(-1, 3)
