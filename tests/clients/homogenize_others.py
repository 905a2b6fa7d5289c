"""CPU time of six load cases of one voxel cell: Druse, the same scheme in numpy, and the elements of muGrid and fedoo.

    python homogenize_others.py DRUSE FOLDER [N]

Needs numpy, muGrid 1.6.1 and fedoo 1.1.0. The cell is Schwarz P at volume fraction 0.3 in sharp voxels, the void 1e-4 as
stiff as the solid (absent in fedoo), residual 1e-4, two threads. numpy takes N / 2 and fedoo N / 4 voxels a side, since
their times grow out of proportion.
"""

import json
import os
import pathlib
import resource
import subprocess
import sys
import time

LAMBDA, MU = 0.3 / (1.3 * 0.4), 1 / 2.6
VOID = 1e-4
PAIRS = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]


def voxels(n, level):
    import numpy as np

    c = np.cos(2 * np.pi * ((np.arange(n) + 0.5) / n - 0.5))
    phi = c[:, None, None] + c[None, :, None] + c[None, None, :]
    return (phi < level).astype(float)


def with_numpy(n, level):
    """Conjugate gradients on the compatibility projection of the rotated scheme (Willot 2015)."""
    import numpy as np

    solid = voxels(n, level)
    weight = VOID + (1 - VOID) * solid
    lam, mu = LAMBDA * weight, MU * weight
    t = np.pi * np.fft.fftfreq(n)
    s, c = np.sin(t), np.cos(t)
    c[n // 2] = 0
    a = [v[:, None, None] for v in (s, c)], [v[None, :, None] for v in (s, c)], [v[None, None, :] for v in (s, c)]
    q = np.stack([a[0][0] * a[1][1] * a[2][1], a[0][1] * a[1][0] * a[2][1], a[0][1] * a[1][1] * a[2][0]])
    norm = np.sqrt((q**2).sum(0))
    q = np.where(norm > 1e-14, q / np.where(norm > 1e-14, norm, 1), 0)
    axes = (-3, -2, -1)

    def project(stress):
        f = np.fft.fftn(stress, axes=axes)
        r = np.einsum("ij...,j...->i...", f, q)
        rq = (q * r).sum(0)
        return np.fft.ifftn(q[:, None] * r + r[:, None] * q - rq * q[:, None] * q, axes=axes).real

    def stress(e):
        out = 2 * mu * e
        out[range(3), range(3)] += lam * np.trace(e)
        return out

    stiffness = np.zeros((6, 6))
    for column, (i, j) in enumerate(PAIRS):
        mean = np.zeros((3, 3))
        mean[i, j] += 0.5
        mean[j, i] += 0.5
        strain = np.broadcast_to(mean[:, :, None, None, None], (3, 3, n, n, n)).copy()
        r = -project(stress(strain))
        p, rr = r.copy(), (r * r).sum()
        end = 1e-8 * rr
        while rr > end:
            ap = project(stress(p))
            step = rr / (p * ap).sum()
            strain += step * p
            r -= step * ap
            rr, old = (r * r).sum(), rr
            p = r + rr / old * p
        average = stress(strain).mean(axis=axes)
        stiffness[:, column] = [average[k, l] for k, l in PAIRS]
    return stiffness.tolist()


def with_mugrid(n, level):
    """Trilinear elements with the preconditioner of a uniform medium."""
    import muGrid
    import numpy as np
    from muGrid.Preconditioners import make_reference_stiffness_preconditioner
    from muGrid.Solvers import conjugate_gradients

    comm = muGrid.Communicator()
    spacing = [1 / n] * 3
    operator = muGrid.IsotropicStiffnessOperator3D(spacing)
    engine = muGrid.FFTEngine([n] * 3, comm, ghosts=operator)
    weight = VOID + (1 - VOID) * voxels(n, level)
    lam, mu = engine.real_space_field("lambda"), engine.real_space_field("mu")
    lam.p[...], mu.p[...] = LAMBDA * weight, MU * weight
    engine.communicate_ghosts(lam)
    engine.communicate_ghosts(mu)
    b, x = engine.real_space_field("b", (3,)), engine.real_space_field("x", (3,))
    prec = make_reference_stiffness_preconditioner(
        engine, element=muGrid.FEMElement.q1, grid_spacing=spacing, nb_components=3,
        lambda_ref=LAMBDA / 2, mu_ref=MU / 2)

    def hessian(u, f):
        engine.communicate_ghosts(u)
        operator.apply(u, lam, mu, f)

    stiffness = np.zeros((6, 6))
    for column, (i, j) in enumerate(PAIRS):
        mean = np.zeros((3, 3))
        mean[i, j] += 0.5
        mean[j, i] += 0.5
        operator.apply_macro_rhs(*(f._cpp for f in (lam, mu)), mean.ravel().tolist(), b._cpp)
        b.p[...] *= -1
        x.p[...] = 0
        conjugate_gradients(comm, engine.real_space_collection, b, x, hessian, prec, rtol=1e-4, maxiter=5000)
        engine.communicate_ghosts(x)
        fields = [f._cpp for f in (x, lam, mu)]
        average = np.reshape(operator.average_stress(*fields, mean.ravel().tolist()), (3, 3))
        stiffness[:, column] = [average[k, l] for k, l in PAIRS]
    return stiffness.tolist()


def with_fedoo(n, level):
    """Trilinear elements of the solid alone and a sparse solver."""
    import fedoo
    import numpy as np

    solid = voxels(n, level)
    fedoo.ModelingSpace("3D")
    box = fedoo.mesh.box_mesh(n + 1, n + 1, n + 1, 0, 1, 0, 1, 0, 1, "hex8")
    place = np.floor(box.nodes[box.elements].mean(axis=1) * n).astype(int)
    mesh = fedoo.Mesh(box.nodes, box.elements[solid[tuple(place.T)] > 0], "hex8")
    mesh.remove_isolated_nodes()
    form = fedoo.weakform.StressEquilibrium(fedoo.constitutivelaw.ElasticIsotrop(1.0, 0.3))
    return np.asarray(fedoo.homogen.get_homogenized_stiffness(fedoo.Assembly.create(form, mesh, "hex8"))).tolist()


def with_druse(n, _, druse, folder):
    out = folder / "c.json"
    command = [druse, "cell", "homogenize", folder / "p.cell", "--resolution", str(n), "--sharp", "--all-loads",
               "--only", "stiffness", "--threads", "2", "-o", str(out), "--progress", "none"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return json.loads(out.read_text())


def child(name, n, level, druse, folder):
    os.environ.update(OMP_NUM_THREADS="2", OPENBLAS_NUM_THREADS="2")
    ways = {"numpy": with_numpy, "muGrid": with_mugrid, "fedoo": with_fedoo, "druse": with_druse}
    before = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN), time.time()
    found = ways[name](n, level, druse, folder) if name == "druse" else ways[name](n, level)
    after = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN), time.time()
    cpu = sum(a.ru_utime + a.ru_stime - b.ru_utime - b.ru_stime for a, b in zip(after[:2], before[:2]))
    peak = max(after[0].ru_maxrss, after[1].ru_maxrss) / 1024
    print(json.dumps({"found": found, "cpu": cpu, "wall": after[2] - before[2], "peak": peak}))


def main():
    druse, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    n = int(sys.argv[3]) if len(sys.argv) > 3 else 64
    cell = folder / "p.cell"
    subprocess.run([druse, "fit", "schwarz_p", "--volume-fraction", "0.3", "-o", cell], check=True, capture_output=True)
    level = json.loads(cell.read_text())["level"]
    for name, size in [("druse", n), ("muGrid", n), ("druse", n // 2), ("numpy", n // 2), ("druse", n // 4), ("fedoo", n // 4)]:
        command = [sys.executable, __file__, "--child", name, str(size), repr(level), druse, str(folder)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        facts = json.loads(done.stdout)
        c = facts["found"]
        if isinstance(c, dict):
            c = c["stiffness"]["voigt"] if isinstance(c["stiffness"], dict) else c["stiffness"]
        print(f"{name:7} N = {size:3}: {facts['cpu']:7.1f} s CPU, {facts['wall']:6.1f} s, {facts['peak']:6.0f} MiB, "
              f"C11 {c[0][0]:.5f}, C12 {c[0][1]:.5f}, C44 {c[3][3]:.5f}")


if __name__ == "__main__":
    if sys.argv[1] == "--child":
        child(sys.argv[2], int(sys.argv[3]), float(sys.argv[4]), sys.argv[5], pathlib.Path(sys.argv[6]))
    else:
        main()
