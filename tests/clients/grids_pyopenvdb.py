"""The grids to shade by, as pyopenvdb and plain bytes see them.

    /usr/bin/python3 grids_pyopenvdb.py DRUSE WORK

Makes a block of two cells with every grid that there is, and the same numbers at the vertices of a .ply.
"""

import os
import struct
import subprocess
import sys

import pyopenvdb as vdb

RECIPE = """druse = 1
unit = "mm"
[cell.a]
surface = "schwarz_p"
volume_fraction = 0.4
[cell.b]
surface = "iwp"
volume_fraction = 0.4
[scaffold]
box = { size = [4, 2, 2], cell_size = 1 }
[tiling]
transition = [{ cell = "a", weight = "1 - bx" }, { cell = "b", weight = "bx" }]
[band]
voxel_size = 0.05
[[output]]
vdb = "shaded.vdb"
unit = "mm"
grids = ["surface", "density", "cell_id", "element_id", "weight_b", "thickness", "uvw", "fold"]
usda = true
[[output]]
mesh = "shaded.ply"
grids = ["cell_id", "element_id", "weight_b", "thickness", "uvw", "fold"]
[[output]]
vdb = "shaded.nvdb"
unit = "mm"
grids = ["surface", "density", "cell_id", "uvw"]
"""


def main():
    druse, work = sys.argv[1:3]
    os.makedirs(work, exist_ok=True)
    recipe = os.path.join(work, "shaded.toml")
    with open(recipe, "w", encoding="utf-8") as file:
        file.write(RECIPE)
    subprocess.run([druse, "run", recipe, "--out", work, "-q"], check=True, stdout=subprocess.DEVNULL)
    path = os.path.join(work, "shaded.vdb")
    grids = {grid.name: grid for grid in vdb.readAll(path)[0]}
    expected = ["cell_id", "density", "element_id", "fold", "surface", "thickness", "uvw", "weight_b"]
    assert sorted(grids) == expected, sorted(grids)
    assert grids["surface"].gridClass == vdb.GridClass.LEVEL_SET
    assert grids["density"].gridClass == vdb.GridClass.FOG_VOLUME
    for name in ("uvw", "fold"):
        assert isinstance(grids[name], vdb.Vec3SGrid), name
    solid = grids["surface"]
    low = min(item.min[0] for item in solid.citerOnValues())
    weight, cell, place = (grids[n].getConstAccessor() for n in ("weight_b", "cell_id", "uvw"))
    checked = 0
    for item in solid.citerOnValues():
        if abs(item.value) > 0.04 or item.count != 1:
            continue
        x = (item.min[0] - low) * 0.05 / 4
        w = weight.getValue(item.min)
        assert abs(w - x) < 0.07, (item.min, w, x)
        assert cell.getValue(item.min) == (1.0 if w > 0.5 else 0.0)
        assert all(abs(c) < 0.51 for c in place.getValue(item.min))
        checked += 1
    assert checked > 10000, checked

    with open(os.path.join(work, "shaded.ply"), "rb") as file:
        data = file.read()
    head, _, body = data.partition(b"end_header\n")
    lines = head.decode().splitlines()
    count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    names = [line.split()[2] for line in lines if line.startswith("property float")]
    assert names[3:] == ["cell_id", "element_id", "weight_b", "thickness", "uvw_x", "uvw_y", "uvw_z",
                         "fold_x", "fold_y", "fold_z"], names
    row = struct.Struct(f"<{len(names)}f")
    rows = [row.unpack_from(body, row.size * n) for n in range(count)]
    assert all(0 <= r[5] <= 1 and 0 < r[6] < 2 for r in rows)
    print(f"{len(grids)} grids, {checked} voxels and {count} vertices agree")


if __name__ == "__main__":
    main()
