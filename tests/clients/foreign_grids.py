"""Grids that other programs write, of every kind that is not Druse's own: read right, or refused by name.

    /usr/bin/python3 foreign_grids.py DRUSE WORK [--fixtures DIRECTORY]

pyopenvdb makes them from closed forms, vdb_tool is a second opinion. With --fixtures only the files of
tests/data/truth/grids are written.
"""

import json
import math
import os
import re
import subprocess
import sys

import numpy as np
import pyopenvdb as vdb

H = 0.1  # edge of a voxel
BAND = 3 * H
N = 16  # voxels from the middle to the end
LOW = (8, 8, 8)  # all voxels in one node of the tree: small files
RADIUS = 0.8
VOID = 0.4  # radius of the void in a hollow ball
BOX = np.array([0.95, 0.75, 0.55])  # half sizes: faces midway between voxels
BALL = 4 / 3 * math.pi * RADIUS**3
HOLLOW = BALL - 4 / 3 * math.pi * VOID**3
LEVEL_SET, FOG = vdb.GridClass.LEVEL_SET, vdb.GridClass.FOG_VOLUME


def ball(p):
    return np.linalg.norm(p, axis=-1) - RADIUS


def block(p):
    q = np.abs(p) - BOX
    return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0)


def affine(matrix, shift=(0, 0, 0)):
    """A transform whose columns are the edges of a voxel."""
    rows = np.zeros((4, 4))
    rows[:3, :3] = np.array(matrix).T
    rows[3] = [*shift, 1]
    return vdb.createLinearTransform(rows.tolist())


CUBES = affine(np.eye(3) * H, [-(N + 8) * H] * 3)


def places(transform, low=LOW, high=(2 * N + 8,) * 3):
    """World positions of the voxels of a box."""
    axes = [np.arange(a, b + 1) for a, b in zip(low, high)]
    index = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    world = np.zeros(index.shape)
    for bits in np.ndindex(2, 2, 2):  # linear along each axis
        share = np.prod([index[..., a] if b else 1 - index[..., a] for a, b in enumerate(bits)], axis=0)
        world += share[..., None] * np.array(transform.indexToWorld(tuple(bits)))
    return world


def grid(values, transform=CUBES, background=BAND, kind=LEVEL_SET, name="surface", low=LOW):
    made = vdb.FloatGrid(background)
    made.name, made.gridClass, made.transform = name, kind, transform
    made.copyFromArray(np.ascontiguousarray(values, "f4"), ijk=low, tolerance=0)
    return made


def clipped(d, band=BAND):
    return np.clip(d, -band, band)


def turned():
    c, s = math.cos(0.5), math.sin(0.5)
    about_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, math.cos(0.3), -math.sin(0.3)], [0, math.sin(0.3), math.cos(0.3)]])
    return about_z @ about_x


def transforms():
    """Name, transform, first and last voxel."""
    mirror = np.diag([-1.0, 1, 1])
    stretch = np.diag([1.0, 0.8, 1.3])
    shear = np.array([[1, 0.3, 0], [0, 1, 0.2], [0, 0, 1]])
    wide = (LOW, (56,) * 3)
    yield "turned", affine(turned() * H, (1, 2, 3)), *wide
    yield "mirrored", affine(mirror * H, (1, 0, 0)), *wide
    yield "stretched", affine(stretch * H), *wide
    yield "sheared", affine(shear * H), *wide
    yield "everything", affine(turned() @ mirror @ shear @ stretch * H, (-1, 0.5, 2)), *wide
    frustum = vdb.createFrustumTransform((0, 0, 0), (60, 60, 40), 0.8, 1.0, 3.2)  # 3.2 wide and deep, 4 at the far end
    yield "frustum", frustum, (0, 0, 0), (60, 60, 40)


def middle(transform, low, high):
    return np.array(transform.indexToWorld(tuple((a + b) / 2 for a, b in zip(low, high))))


def spoilt():
    """Files of grids that are no plain level sets, by name."""
    d = ball(places(CUBES))
    c = clipped(d)
    yield "even", [grid(c)]
    yield "inside_out", [grid(-c, background=-BAND)]
    yield "inside_out_positive", [grid(-c)]
    hole = c.copy()
    hole[8:16, N + 4 : N + 12, N - 4 : N + 4] = BAND  # a cube of the band says "outside"
    yield "torn", [grid(hole)]
    yield "unsigned", [grid(np.abs(c))]
    yield "fog255", [grid(np.clip(0.5 - d / H, 0, 1) * 255, background=0, kind=FOG, name="density")]
    # The fog of a level set, as OpenVDB makes it: 0 at the surface, 1 three voxels inside.
    yield "ramp_fog", [grid(np.clip(-d / (3 * H), 0, 1), background=0, kind=FOG, name="density")]
    yield "fog", [grid(np.clip(0.5 - d / H, 0, 1), background=0, kind=FOG, name="density")]
    yield "no_class", [grid(c, kind=vdb.GridClass.UNKNOWN)]
    yield "voxels", [grid(c / H, background=3)]
    yield "millimetres", [grid(c * 1000, background=300)]
    yield "no_background", [grid(c, background=0)]
    yield "wide_background", [grid(c, background=1)]
    yield "narrow", [grid(clipped(d, 0.4 * H), background=0.4 * H)]
    bad = grid(c)
    access = bad.getAccessor()
    access.setValueOn((N + 16, N + 8, N + 8), math.nan)
    access.setValueOn((N + 16, N + 8, N + 9), math.inf)
    yield "nan", [bad]
    signs = grid(c)
    access = signs.getAccessor()
    for ijk in np.argwhere(c <= -BAND):
        access.setValueOff(tuple(int(v) + LOW[0] for v in ijk), BAND)
    yield "signs", [signs]
    hollow = np.maximum(d, VOID - np.linalg.norm(places(CUBES), axis=-1))
    yield "hollow", [grid(clipped(hollow))]
    yield "hollow_fog", [grid(np.clip(0.5 - hollow / H, 0, 1), background=0, kind=FOG, name="density")]
    yield "half", [grid(c)]
    yield "two", [grid(c, name="left"), grid(c, name="right")]
    yield "empty", [grid(np.full_like(c, BAND))]
    switch = vdb.BoolGrid()
    switch.name, switch.transform = "mask", CUBES
    switch.copyFromArray(d < 0, ijk=LOW)
    vectors = vdb.Vec3SGrid()
    vectors.name, vectors.transform = "v", CUBES
    vectors.copyFromArray(places(CUBES).astype("f4"), ijk=LOW)
    yield "mask", [switch]
    yield "vectors", [vectors]


def write(work):
    made = {}
    for name, transform, low, high in transforms():
        at = middle(transform, low, high)
        for shape, distance in (("ball", ball), ("block", block)):
            path = f"{work}/{name}_{shape}.vdb"
            values = clipped(distance(places(transform, low, high) - at))
            vdb.write(path, grids=[grid(values, transform, low=low)])
            made[f"{name}_{shape}"] = (path, at)
    for name, grids in spoilt():
        path = f"{work}/{name}.vdb"
        for g in grids:
            g.saveFloatAsHalf = name == "half"
        vdb.write(path, grids=grids)
        made[name] = (path, np.zeros(3))
    return made


def fixtures(directory):
    """Small ones for the laws in Rust: no blocks, half floats."""
    made = write(directory)
    kept = ["turned_ball", "everything_ball", "frustum_block", "mirrored_block", "stretched_ball", "inside_out",
            "inside_out_positive", "torn", "unsigned", "fog255", "no_class", "voxels", "no_background", "nan",
            "narrow", "two", "mask", "signs", "hollow_fog"]
    for name, (path, _) in made.items():
        if name not in kept:
            os.remove(path)


class Client:
    def __init__(self, druse, work):
        self.druse, self.work, self.failures = druse, work, []

    def run(self, *arguments):
        found = subprocess.run([self.druse, *map(str, arguments)], capture_output=True, text=True)
        if found.returncode not in (0, 1, 65):
            self.fail(arguments, f"exit code {found.returncode}: {found.stderr}")
        return found

    def fail(self, what, why):
        self.failures.append(f"{what}: {why}")

    def check(self, what, passed, why=""):
        if not passed:
            self.fail(what, why)

    def mesh(self, path, *options):
        """Volume and middle of the mesh of a file."""
        out = f"{self.work}/mesh.stl"
        found = self.run("mesh", path, "-o", out, "--out-unit", "m", *options)
        if found.returncode != 0:
            return None, found.stderr
        facts = json.loads(self.run("info", out, "--json").stdout)
        whole = facts["closed"] and facts["oriented"]
        at = np.mean(np.array(facts["box"]), axis=0)
        return (facts["volume"] if whole else math.nan, at), found.stderr

    def is_solid(self, what, path, volume, at, tolerance, *options):
        found, text = self.mesh(path, *options)
        if found is None:
            return self.fail(what, text)
        self.check(what, abs(found[0] / volume - 1) < tolerance, f"volume {found[0]}, expected {volume}")
        self.check(what, np.abs(found[1] - at).max() < 0.1 * H, f"middle {found[1]}, expected {at}")
        return text

    def is_refused(self, what, path, *words, command="mesh"):
        found = self.run(command, path, "-o", f"{self.work}/none.stl") if command == "mesh" else self.run(command, path)
        text = found.stdout + found.stderr
        self.check(what, found.returncode != 0, "not refused")
        for word in words:
            self.check(what, word in text, f"{word!r} is not in {text!r}")
        return text


def placed(client, made):
    """Transforms that are not plain: by command line, by the operation, and as vdb_tool sees them."""
    volumes = {"ball": BALL, "block": 8 * BOX.prod()}
    for name, *_ in transforms():
        for shape, volume in volumes.items():
            path, at = made[f"{name}_{shape}"]
            text = client.is_refused(name, path, "--resample", "resample = true")
            hint = re.search(r"druse filter FILE -o CUBES.vdb (resample=[0-9.e-]+)", text)
            client.check(name, hint is not None, text)
            client.is_solid(f"{name} {shape}", path, volume, at, 0.02, "--resample")
            if shape == "ball":  # what depends on the transform alone
                client.is_solid(f"{name} {shape}, finer", path, volume, at, 0.02, "--resample=0.08m")
                client.is_refused(name, path, "NOT sound", "--resample", command="check")
            if hint is None:
                continue
            cubes = f"{client.work}/cubes.vdb"
            found = client.run("filter", path, "-o", cubes, hint[1])
            client.check(name, found.returncode == 0, found.stderr)
            again = vdb.read(cubes, "surface")
            size = again.transform.voxelSize()
            client.check(name, max(size) - min(size) < 1e-9 * size[0], f"voxels {size}")
            check = client.run("check", cubes)
            client.check(name, check.returncode == 0, check.stdout)
            errors = []
            for item in again.citerOnValues():
                ijk, value = item.min, item.value
                world = np.array(again.transform.indexToWorld(ijk)) - at
                exact = (ball if shape == "ball" else block)(world)
                if abs(exact) < 0.15 and len(errors) < 4000:
                    errors.append(value - exact)
            rms = float(np.sqrt(np.mean(np.square(errors))))
            client.check(name, rms < 0.15 * H, f"distances {rms / H:.3f} voxels off")
        # A second opinion: OpenVDB meshes the grid as it stands.
        path, at = made[f"{name}_ball"]
        ply = f"{client.work}/tool.ply"
        subprocess.run(["/usr/bin/vdb_tool", "-read", path, "-ls2mesh", "-write", ply], capture_output=True)
        if os.path.exists(ply):
            theirs = abs(json.loads(client.run("info", ply, "--json").stdout)["volume"])
            ours, text = client.mesh(path, "--resample")
            same = ours is not None and abs(ours[0] / theirs - 1) < 0.02
            client.check(name, same, f"vdb_tool finds {theirs}, Druse {ours} {text}")
            os.remove(ply)
        print(f"{name}: right volume, place and distances")


def levels(client, made):
    """Level sets with faults."""
    none = np.zeros(3)

    def path(name):
        return made[name][0]

    client.is_solid("even", path("even"), BALL, none, 0.02)
    client.is_solid("half", path("half"), BALL, none, 0.02)
    client.is_solid("fog", path("fog"), BALL, none, 0.03)
    client.is_solid("fog of a level set", path("ramp_fog"), BALL, none, 0.01)
    for name in ("inside_out", "inside_out_positive"):
        client.is_refused(name, path(name), "inside out", "--invert", "invert = true")
        client.is_refused(name, path(name), "inside out", "--invert", command="check")
        client.is_solid(name, path(name), BALL, none, 0.02, "--invert")
        info = client.run("info", path(name)).stdout
        client.check(name, "inside out" in info, info)
    text = client.run("mesh", path("even"), "-o", f"{client.work}/x.stl", "--invert").stderr
    client.check("invert", "leave out invert" in text, text)
    client.is_refused("torn", path("torn"), "torn", "the first at (")
    client.is_refused("torn", path("torn"), "torn", command="check")
    client.is_refused("unsigned", path("unsigned"), "unsigned", "--value 0.1")
    wall = 4 / 3 * math.pi * ((RADIUS + 0.15) ** 3 - (RADIUS - 0.15) ** 3)
    client.is_solid("unsigned", path("unsigned"), wall, none, 0.02, "--value", "0.15")
    client.is_solid("hollow", path("hollow"), HOLLOW, none, 0.02)
    client.is_solid("hollow", path("hollow"), HOLLOW, none, 0.02, "--value", "0")
    client.is_solid("hollow fog", path("hollow_fog"), HOLLOW, none, 0.03)
    client.is_refused("narrow", path("narrow"), "band", "--value 0")
    client.is_solid("narrow", path("narrow"), BALL, none, 0.06, "--value", "0")
    client.is_refused("fog255", path("fog255"), "0 to 255", "--value 127.5", "value = 127.5")
    client.is_solid("fog255", path("fog255"), BALL, none, 0.03, "--value", "127.5")
    info = client.run("info", path("fog255")).stdout
    client.check("fog255", "fog volume" in info and "to 255" in info, info)
    client.is_refused("nan", path("nan"), "NaN at voxel [32, 24, 24], (0.8, 0, 0)", "the first of 2")
    client.is_refused("two", path("two"), "left", "right", "--grid")
    client.is_solid("two", path("two"), BALL, none, 0.02, "--grid", "right")
    client.is_refused("mask", path("mask"), "on or off")
    client.is_refused("vectors", path("vectors"), "vectors")
    client.is_refused("empty", path("empty"))
    for name, word in (("signs", "wrong sign"), ("no_class", "class"), ("voxels", "count voxels"), ("millimetres", "1000"), ("no_background", "background")):
        text = client.is_solid(name, path(name), BALL, none, 0.02)
        client.check(name, text is not None and "W117" in text and word in text, f"{text!r}")
        out = f"{client.work}/grown.vdb"
        found = client.run("filter", path(name), "-o", out, "dilate=0.1m", "--json")
        grown = json.loads(found.stdout)["solid"]["volume"] / (4 / 3 * math.pi * (RADIUS + 0.1) ** 3)
        client.check(name, abs(grown - 1) < 0.02, f"grown to {grown} of its volume")
    client.is_solid("wide_background", path("wide_background"), BALL, none, 0.02)
    print("level sets and fogs with faults: named, mended or refused")


# Edge of the averaged cubes, voxels, by radius of the ball.
STEPS = {60: 4, 120: 8}
CODECS = ("none", "zip", "active")


def averages(client):
    """Views of level sets that are averaged over cubes of voxels as the file is read."""
    names = ("plain", "half", "far", "filled", *CODECS)
    small = [(60, n) for n in (*names, "named", "beside_a_fog", "stretched")]
    for radius, name in small + [(120, n) for n in ("plain", "filled", "zip")]:
        shift = 700 * H if name == "far" else 0.0
        sphere = vdb.createLevelSetSphere(radius * H, (-shift, shift, 0), H)
        sphere.name = "part" if name == "named" else "surface"
        sphere.saveFloatAsHalf = name == "half"
        if name == "filled":  # active tiles
            sphere.fill((-24, -24, -24), (24, 24, 24), -BAND, True)
        if name == "stretched":
            sphere.transform = affine(np.diag([H, 1.5 * H, H]))
        fog = vdb.createLevelSetSphere(radius * H / 2, (0, 0, 0), H)
        fog.gridClass, fog.name = FOG, "density"
        path = f"{client.work}/{name}.vdb"
        vdb.write(path, [fog, sphere] if name == "beside_a_fog" else [sphere])
        if name in CODECS:
            coded = f"{client.work}/coded.vdb"
            subprocess.run(["vdb_tool", "-quiet", "-read", path, "-write", f"codec={name}", coded], check=True)
            os.replace(coded, path)
        name = f"{name}, averaged over {STEPS[radius]}^3"
        found = client.run("view", path, "-o", f"{client.work}/page.html", "--json", "--no-thickness", "--triangles", "2k")
        if found.returncode != 0:
            client.fail(name, found.stderr)
            continue
        seen = json.loads(found.stdout.splitlines()[-1])
        body = seen["bodies"][0]
        whole = body["closed"] and (body["parts"], body["cavities"]) == (1, 0)
        client.check(name, whole, body)
        is_stretched = name.startswith("stretched")
        edges = 2 * radius * H * np.array([1, 1.5 if is_stretched else 1, 1])
        client.check(name, np.abs(seen["size"] / edges - 1).max() < 0.02, f"{seen['size']}, expected {edges}")
        # Voxels that are no cubes are resampled, not averaged.
        text = " ".join(seen["notes"])
        is_averaged = f"{STEPS[radius]} times those of the file" in text
        client.check(name, is_averaged != is_stretched, text)
    print("averages for views: whole, and as large as the level set")


def main():
    if "--fixtures" in sys.argv:
        return fixtures(sys.argv[-1])
    druse, work = sys.argv[1:3]
    os.makedirs(work, exist_ok=True)
    made = write(work)
    client = Client(druse, work)
    placed(client, made)
    levels(client, made)
    averages(client)
    for failure in client.failures:
        print("FAILED", failure)
    return 1 if client.failures else 0


if __name__ == "__main__":
    sys.exit(main())
