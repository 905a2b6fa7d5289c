"""Commands on files beside OpenVDB's own tool: CPU seconds of both, on the same files, in one run.

    python3 files_table.py DRUSE [--quick] [--mesh CLOSED.obj] [--runs N] [--bracket RUN] [DIRECTORY]

Needs numpy and vdb_tool (Debian: libopenvdb-tools). Without --mesh a bumpy ball of as many triangles as the Stanford
bunny stands in for it; --bracket is the directory into which examples/quickstart wrote. Where the module picopie can be
imported, what PicoGK takes for the same is told too. Times are user and system seconds of a command and of its
children, the least of N runs in turns. With --quick everything is small, and only results are looked at: a row fails if
what a command wrote is not what it should be. Times never fail: they depend on the machine.
"""

import argparse
import json
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import time

import numpy as np

LATTICE = """druse = 1
unit = "mm"
[cell.struts]
mesh = "%s"
band_limit = 10
[scaffold]
box = { size = [18, 18, 18], cell_size = 6 }
[tiling]
cell = "struts"
[band]
voxel_size = %s
half_width = 3
[[output]]
vdb = "lattice.vdb"
"""

PICOGK = """import sys
import picopie
task, source, target, voxel, length = sys.argv[1:]
picopie.init(float(voxel))
if task == "voxelize":
    solid = picopie.Voxels.from_mesh(picopie.Mesh.load_obj(source))
else:
    solid = picopie.VdbFile.load(source).get_voxels(0)
if task == "dilate":
    solid.offset_(float(length))
if task == "mesh":
    solid.to_mesh().save_stl(target)
else:
    file = picopie.VdbFile()
    file.add_voxels("surface", solid)
    file.save(target)
"""


def call(command):
    """CPU and wall seconds of a command with its children, and what it printed."""
    command = [str(word) for word in command]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        start = time.monotonic()
        process = subprocess.Popen(command, stdout=out, stderr=err)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.monotonic() - start
        out.seek(0)
        err.seek(0)
        if process.returncode != 0:
            sys.exit(f"{' '.join(command)}: exit code {process.returncode}\n{err.read().decode()}")
        return usage.ru_utime + usage.ru_stime, wall, out.read().decode()


def bumpy_ball(levels):
    """An icosahedron, divided, whose places lie on a ball of radius 1 with waves of 8 %."""
    golden = (1 + 5**0.5) / 2
    corners = [(s, t * golden, 0.0) for s in (-1.0, 1.0) for t in (-1.0, 1.0)]
    places = np.array([np.roll(c, n) for n in range(3) for c in corners])
    faces = []
    for a in range(12):
        near = [b for b in range(12) if 0 < np.linalg.norm(places[a] - places[b]) < 2.1]
        for b in near:
            for c in near:
                if a < b < c and np.linalg.norm(places[b] - places[c]) < 2.1:
                    outward = np.dot(np.cross(places[b] - places[a], places[c] - places[a]), places[a])
                    faces.append((a, b, c) if outward > 0 else (a, c, b))
    faces = np.array(faces)
    for _ in range(levels):
        places, faces = divided(places, faces)
        places /= np.linalg.norm(places, axis=1)[:, None]
    waves = np.sin(7 * places[:, 0]) * np.sin(6 * places[:, 1]) * np.cos(5 * places[:, 2])
    return places * (1 + 0.08 * waves)[:, None], faces


def divided(places, faces):
    """Each triangle in four; the middles of edges are shared."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, number = np.unique(edges, axis=0, return_inverse=True)
    ab, bc, ca = number.reshape(3, -1) + len(places)
    a, b, c = faces.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([places, places[edges].mean(axis=1)]), np.concatenate([np.stack(p, 1) for p in parts])


def read_obj(path):
    places, faces = [], []
    with open(path, encoding="utf-8") as file:
        for line in file:
            words = line.split()
            if words[:1] == ["v"]:
                places.append([float(w) for w in words[1:4]])
            elif words[:1] == ["f"]:
                faces.append([int(w.split("/")[0]) - 1 for w in words[1:4]])
    return np.array(places), np.array(faces)


def write_obj(path, places, faces):
    with open(path, "w", encoding="utf-8") as file:
        np.savetxt(file, places, fmt="v %.9g %.9g %.9g")
        np.savetxt(file, faces + 1, fmt="f %d %d %d")


def mesh_volume(path):
    """Volume inside the triangles or quads of a binary .stl or .ply."""
    data = path.read_bytes()
    if path.suffix == ".stl":
        count = struct.unpack_from("<I", data, 80)[0]
        rows = np.frombuffer(data, dtype=[("v", "<f4", (4, 3)), ("attribute", "<u2")], offset=84, count=count)
        corners = rows["v"][:, 1:].astype(float)
    else:
        head, _, body = data.partition(b"end_header\n")
        words = head.decode().split()
        vertices, faces = (int(words[words.index(kind) + 1]) for kind in ("vertex", "face"))
        places = np.frombuffer(body, dtype="<f4", count=3 * vertices).reshape(-1, 3).astype(float)
        kind = 4 if body[12 * vertices] == 4 else 3
        rows = np.frombuffer(body, dtype=[("n", "u1"), ("v", "<i4", (kind,))], offset=12 * vertices, count=faces)
        if (rows["n"] != kind).any():
            sys.exit(f"{path}: faces of more than one kind")
        corners = places[rows["v"][:, :3]]
        if kind == 4:
            corners = np.concatenate([corners, places[rows["v"][:, [0, 2, 3]]]])
    corners = corners - corners.reshape(-1, 3).mean(axis=0)
    return abs(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6


class Table:
    """Rows as they are measured, and what was wrong with their results."""

    def __init__(self, druse, runs, quick):
        self.druse, self.runs, self.quick, self.wrong = druse, runs, quick, []
        self.picogk = subprocess.run([sys.executable, "-c", "import picopie; picopie.init"], capture_output=True).returncode == 0
        if not quick:
            print("| command | druse CPU s (wall) | beside it | its CPU s (wall) | share | at most |")
            print("|---|---|---|---|---|---|")

    def expect(self, name, is_right, found):
        if self.quick:
            print(f"{name:46} {'ok' if is_right else 'WRONG'}: {found}")
        if not is_right:
            self.wrong.append(f"{name}: {found}")

    def row(self, name, ours, others, most=None):
        """Times a command of Druse's in turns with others, a list of (what, command)."""
        best = {}
        for _ in range(1 if self.quick else self.runs):
            for what, command in [("druse", [self.druse, *ours]), *others]:
                best[what] = min(best.get(what, (float("inf"),) * 2), call(command)[:2])
        if self.quick:
            return
        own = f"| {name} | {best['druse'][0]:.2f} ({best['druse'][1]:.2f})"
        limit = "" if most is None else f"{most}"
        for what, _ in others:
            cpu, wall = best[what]
            print(f"{own} | {what} | {cpu:.2f} ({wall:.2f}) | {best['druse'][0] / cpu:.2f} | {limit} |", flush=True)
            limit = ""
        if not others:
            print(f"{own} | | | | {limit} |", flush=True)

    def info(self, path):
        return json.loads(call([self.druse, "info", "--json", path])[2])


def close(one, other, share):
    return abs(one / other - 1) <= share


def make_meshes(given, quick, directory):
    """A closed mesh and its division, as .obj: (path, places, faces) of each."""
    places, faces = read_obj(given) if given else bumpy_ball(4 if quick else 6)
    meshes = []
    for n in range(2):
        path = directory / f"mesh_{n}.obj"
        write_obj(path, places, faces)
        meshes.append((path, places, faces))
        for _ in range(1 if quick else 2):
            places, faces = divided(places, faces)
    return meshes


def measures(places, faces):
    a, b, c = (places[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return np.einsum("ij,ij->", a, normals) / 6, np.linalg.norm(normals, axis=1).sum() / 2


def tool(source, target, *words):
    return ["vdb_tool", "-quiet", "-read", source, *words, "-write", target]


def files(table, meshes, directory):
    """Meshes to level sets, operations, copies, and back to meshes."""
    volume, area = measures(*meshes[0][1:])
    voxel = (6 * area / (2e5 if table.quick else 3e6)) ** 0.5

    def picogk(task, source, target, length=0):
        command = [sys.executable, "-c", PICOGK, task, source, target, voxel, length]
        return [("PicoGK", command)] if table.picogk else []

    def path(name):
        return directory / name

    def solid(name):
        """Volume of a level set, and what it is."""
        answer = call([table.druse, "filter", path(name), "prune", "-o", path("seen.vdb"), "--json"])
        return json.loads(answer[2])["solid"]["volume"], table.info(path(name))

    for n, (mesh, places, _) in enumerate(meshes):
        ours = ["voxelize", mesh, "-o", path(f"ours_{n}.vdb"), "--voxel-size", voxel, "--unit", "mm", "--out-unit", "mm"]
        theirs = tool(mesh, path(f"theirs_{n}.vdb"), "-mesh2ls", f"voxel={voxel}", "width=3")
        beside = picogk("voxelize", mesh, path(f"picogk_{n}.vdb"))
        table.row(f"voxelize {len(meshes[n][2]):,} triangles", ours, [("vdb_tool", theirs), *beside])
        if table.quick:
            found, other = (solid(f"{who}_{n}.vdb")[0] for who in ("ours", "theirs"))
            table.expect(f"voxelize mesh {n}", close(found, volume, 5e-3) and close(other, volume, 5e-3), (found, other, volume))
    part, own = path("ours_0.vdb"), path("picogk_0.vdb")
    before, info = solid("ours_0.vdb")
    active = info["grids"][0]["active_voxels"]
    told = f"{active / 1e6:.1f} M active voxels"

    row = [("vdb_tool", tool(part, path("copy_theirs.vdb"))), *picogk("copy", own, path("copy_picogk.vdb"))]
    table.row(f"read and write, {told}", ["filter", part, "prune", "-o", path("copy.vdb")], row, 1.5)
    if table.quick:
        hashes = [table.info(path(name))["content_hash"] for name in ("ours_0.vdb", "copy.vdb")]
        table.expect("read and write: content hash", hashes[0] == hashes[1], hashes)
        other, seen = solid("copy_theirs.vdb")
        is_same = other == before and seen["grids"][0]["active_voxels"] == active
        table.expect("read and write: vdb_tool's copy", is_same, (other, before))

    operations = [
        ("dilate", f"dilate={voxel}", ("-dilate", "radius=1")),
        ("gaussian", "gaussian={width=1,iterations=1}", ("-gauss", "size=1", "iter=1")),
        ("mean", "mean={width=1,iterations=1}", ("-mean", "size=1", "iter=1")),
    ]
    for name, ours, words in operations:
        row = [("vdb_tool", tool(part, path(f"{name}_theirs.vdb"), *words))]
        if name == "dilate":
            row += picogk(name, own, path("dilate_picogk.vdb"), voxel)
        table.row(f"{name}, {told}", ["filter", part, ours, "-o", path(f"{name}.vdb")], row)
        if table.quick:
            found, other = (solid(file)[0] for file in (f"{name}.vdb", f"{name}_theirs.vdb"))
            grown = before + area * voxel if name == "dilate" else before
            table.expect(name, close(found, other, 3e-3) and close(found, grown, 2e-2), (found, other, before))

    for ending in ("ply", "stl"):
        # The tool writes no .stl of its quads.
        row = [("vdb_tool, .ply", tool(part, path("theirs.ply"), "-ls2mesh", "adapt=0"))]
        if ending == "stl":
            row += picogk("mesh", own, path("picogk.stl"))
        mesh = path(f"mesh.{ending}")
        table.row(f"mesh to .{ending}, {told}", ["mesh", part, "-o", mesh], row, 1.0)
        if table.quick:
            found, other = mesh_volume(mesh), mesh_volume(path("theirs.ply"))
            is_right = close(found, before, 2e-3) and close(found, other, 2e-3)
            table.expect(f"mesh to .{ending}", is_right, (found, other, before))
            passed = json.loads(call([table.druse, "check", "--json", mesh])[2])["passed"]
            table.expect(f"mesh to .{ending}: sound", passed, passed)


def lattice(table, directory):
    """What measuring takes after the band: stages of one run, as its report tells them."""
    recipe = directory / "lattice.toml"
    struts = pathlib.Path(__file__).resolve().parents[1] / "data" / "strut_hex.stl"
    recipe.write_text(LATTICE % (struts, 0.15 if table.quick else 0.0364), encoding="utf-8")
    best = {}
    for _ in range(1 if table.quick else table.runs):
        call([table.druse, "run", recipe, "--quiet", "--out", directory / "lattice"])
        report = json.loads((directory / "lattice" / "report.json").read_text(encoding="utf-8"))
        for stage in report["stages"]:
            best[stage["name"]] = min(best.get(stage["name"], float("inf")), stage["seconds"])
    if table.quick:
        found = report["solid"]
        # On voxels of 0.042 mm: 955.26 mm^3, walls of 0.593 mm.
        table.expect("lattice: volume, mm^3", close(found["volume"], 955.26, 0.03), found["volume"])
        table.expect("lattice: one piece", found["components"] == 1, found["components"])
        wall = found["least_wall"]
        table.expect("lattice: least wall, mm", close(wall, 0.593, 0.1), wall)
        return
    active = report["band"]["active_voxels"]
    name = f"measure and walls of a lattice, {active / 1e6:.1f} M active voxels, wall s"
    spent = best["measure"] + best["walls"]
    share = spent / best["band"]
    print(f"| {name} | {spent:.2f} | its band, wall s | {best['band']:.2f} | {share:.2f} | 0.5 |")


def previews(table, bracket, directory):
    recipe = 'druse = 1\nunit = "mm"\n[band]\nvoxel_size = 0.1\n[[op]]\nunion = { sphere = { radius = 2.5 } }\n'
    (directory / "ball.toml").write_text(recipe + '[[output]]\nvdb = "ball.vdb"\n', encoding="utf-8")
    call([table.druse, "run", directory / "ball.toml", "--quiet", "--out", directory])
    pictures = [("ball of radius 25 voxels", directory / "ball.vdb", 1)]
    if bracket and not table.quick:
        pictures.append(("the bracket", bracket / "bracket.vdb", 2))
    for name, source, most in pictures:
        target = directory / "picture.png"
        table.row(f"preview of {name}", ["preview", source, "-o", target], [], f"{most} s")
        head = target.read_bytes()
        size = struct.unpack(">II", head[16:24])
        table.expect(f"preview of {name}", head[1:4] == b"PNG" and len(head) > 5000, (*size, len(head)))


def main():
    words = argparse.ArgumentParser()
    words.add_argument("druse", type=pathlib.Path)
    words.add_argument("--quick", action="store_true")
    words.add_argument("--mesh", type=pathlib.Path)
    words.add_argument("--runs", type=int, default=3)
    words.add_argument("--bracket", type=pathlib.Path)
    words.add_argument("directory", nargs="?", type=pathlib.Path)
    p = words.parse_intermixed_args()
    with tempfile.TemporaryDirectory() as own:
        directory = p.directory or pathlib.Path(own)
        directory.mkdir(parents=True, exist_ok=True)
        table = Table(p.druse.resolve(), p.runs, p.quick)
        files(table, make_meshes(p.mesh, p.quick, directory), directory)
        lattice(table, directory)
        previews(table, p.bracket, directory)
    sys.exit("\n".join(table.wrong) if table.wrong else 0)


if __name__ == "__main__":
    main()
