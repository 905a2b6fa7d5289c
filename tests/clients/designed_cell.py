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


def directions(n):
    """Unit frequencies of the rotated scheme; zero where no compatible field is."""
    k = np.fft.fftfreq(n, 1 / n)
    sine, cosine = np.sin(np.pi * k / n), np.cos(np.pi * k / n)
    cosine = np.where(np.abs(2 * k) == n, 0.0, cosine)
    s, c = (np.meshgrid(w, w, w, indexing="ij") for w in (sine, cosine))
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
    identity = np.eye(3)[:, :, None, None, None]

    def stress(e):
        return lam * np.trace(e) * identity + 2 * mu * e

    def project(s):
        f = np.fft.fftn(s, axes=(-3, -2, -1))
        t = np.einsum("ij...,j...->i...", f, q)
        along = (q * t).sum(0)
        f = q[:, None] * t[None] + t[:, None] * q[None] - along * q[:, None] * q[None]
        return np.fft.ifftn(f, axes=(-3, -2, -1)).real

    mean = np.broadcast_to(identity, (3, 3, n, n, n))
    x = np.zeros_like(mean, dtype=float)
    r = -project(stress(mean))
    p, square = r.copy(), (r * r).sum()
    goal = 1e-8 * square
    while square > goal:
        image = project(stress(p))
        step = square / (p * image).sum()
        x += step * p
        r -= step * image
        square, last = (r * r).sum(), square
        p = r + square / last * p
    return np.trace(stress(mean + x)).mean() / 9


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
