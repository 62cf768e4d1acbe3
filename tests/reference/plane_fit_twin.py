"""Plain twin of `core.plane_fit`: each pixel by NumPy's least squares."""

import numpy as np


def fit_planes(inverse, radius, tolerance):
    rows, columns = inverse.shape
    planes = np.zeros((3, rows, columns))
    for i in range(rows):
        for j in range(columns):
            q = float(inverse[i, j])
            if q <= 0:
                continue
            kept = []
            for y in range(max(i - radius, 0), min(i + radius, rows - 1) + 1):
                for x in range(max(j - radius, 0), min(j + radius, columns - 1) + 1):
                    reach = tolerance * (1 + max(abs(x - j), abs(y - i)))
                    if inverse[y, x] > 0 and abs(float(inverse[y, x]) - q) <= reach:
                        kept.append((1, x - j, y - i, float(inverse[y, x])))
            known = np.array(kept, float)
            moments = known[:, :3].T @ known[:, :3]
            spread = np.linalg.det(moments) * moments[0, 0]
            if len(kept) < 6 or spread <= 1e-3 * len(kept) ** 4:
                planes[:, i, j] = q, 0, 0
            else:
                planes[:, i, j] = np.linalg.lstsq(known[:, :3], known[:, 3], rcond=None)[0]
    planes[0] = np.maximum(planes[0], 0)
    return planes
