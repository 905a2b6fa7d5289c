"""The bulk modulus of a designed .cell file, by numpy alone, against the figures in the file.

    python3 designed_cell.py X.cell [N]

Evaluates the series, finds the level of the volume fraction on sharp voxels, and homogenises them by conjugate
gradients on the compatibility projection, Willot's rotated scheme. The voxels are those whose middle is solid;
Druse takes the share of solid of eight parts, so that figures differ by the voxels that the surface cuts in half.
"""

import json
import sys

import numpy as np

from cell_numpy import evaluate

VOID, POISSON = 1e-4, 0.3
TOLERANCE = 0.03


# Places of 11 22 33 23 13 12 among the components of a symmetric tensor, and back.
PAIRS = ((0, 1, 2, 1, 0, 0), (0, 1, 2, 2, 2, 1))
FULL = ((0, 5, 4), (5, 1, 3), (4, 3, 2))


def directions(n):
    """Unit frequencies of the rotated scheme, of half the spectrum; zero where no compatible field is."""
    k = np.fft.fftfreq(n, 1 / n)
    sine, cosine = np.sin(np.pi * k / n), np.cos(np.pi * k / n)
    cosine = np.where(np.abs(2 * k) == n, 0.0, cosine)
    s, c = (np.meshgrid(w, w, w[: n // 2 + 1], indexing="ij") for w in (sine, cosine))
    q = np.stack([s[0] * c[1] * c[2], c[0] * s[1] * c[2], c[0] * c[1] * s[2]])
    size = np.sqrt((q**2).sum(0))
    none = size < 1e-14
    return np.where(none, 0, q / np.where(none, 1, size))


def bulk_modulus(solid):
    """Of a boolean array, relative to the solid's Young's modulus."""
    n = len(solid)
    q = directions(n)
    scale = np.where(solid, 1.0, VOID)
    lam, mu = (scale * m for m in (POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), 1 / (2 * (1 + POISSON))))
    counts = np.array([1, 1, 1, 2, 2, 2.0])  # of each component in a product of tensors

    def stress(e):
        s = 2 * mu * e
        s[:3] += lam * e[:3].sum(0)
        return s

    def project(s):
        f = np.fft.rfftn(s, axes=(-3, -2, -1))
        t = np.stack([sum(f[FULL[i][j]] * q[j] for j in range(3)) for i in range(3)])
        along = (q * t).sum(0)
        for k, (i, j) in enumerate(zip(*PAIRS)):
            f[k] = q[i] * t[j] + t[i] * q[j] - along * q[i] * q[j]
        return np.fft.irfftn(f, s.shape[1:], axes=(-3, -2, -1))

    def product(a, b):
        return counts @ (a * b).sum((1, 2, 3))

    mean = np.zeros((6, n, n, n))
    mean[:3] = 1.0
    x = np.zeros_like(mean)
    r = -project(stress(mean))
    p, square = r.copy(), product(r, r)
    goal = 1e-8 * square
    while square > goal:
        image = project(stress(p))
        step = square / product(p, image)
        x += step * p
        r -= step * image
        square, last = product(r, r), square
        p = r + square / last * p
    return stress(mean + x)[:3].sum(0).mean() / 9


def upper_bound(fraction):
    """Hashin and Shtrikman 1963."""
    bulk, shear = 1 / (3 * (1 - 2 * POISSON)), 1 / (2 * (1 + POISSON))
    stiff = 4 / 3 * shear
    return 1 / (fraction / (bulk + stiff) + (1 - fraction) / (VOID * bulk + stiff)) - stiff


def main():
    path = sys.argv[1]
    cell = json.load(open(path))
    figures = cell["report"]["design"]["properties"]
    n = int(sys.argv[2]) if len(sys.argv) > 2 else figures[0]["voxels"]
    own = next(f for f in figures if f["voxels"] == n)
    u = (np.arange(n) + 0.5) / n - 0.5
    half = np.array([p for p in np.ndindex(n // 2, n // 2, n // 2)])
    phi = evaluate(path, u[half]).reshape((n // 2,) * 3)
    phi = np.concatenate([phi, phi[::-1]], 0)
    phi = np.concatenate([phi, phi[:, ::-1]], 1)
    phi = np.concatenate([phi, phi[:, :, ::-1]], 2)
    phi = np.abs(phi) if cell["solid"] == "sheet" else phi
    solid = phi < cell["level"]
    bulk = bulk_modulus(solid)
    fraction = solid.mean()
    print(f"{path}: {n} voxels, volume fraction {fraction:.4f}, bulk modulus {bulk:.5f}, "
          f"{bulk / upper_bound(fraction):.4f} of the bound; Druse: {own['bulk']:.5f}, {own['bulk_over_bound']:.4f}")
    assert bulk < upper_bound(fraction), "the bound is crossed"
    off = abs(bulk / upper_bound(fraction) / own["bulk_over_bound"] - 1)
    sys.exit(0 if off < TOLERANCE else 1)


if __name__ == "__main__":
    main()
