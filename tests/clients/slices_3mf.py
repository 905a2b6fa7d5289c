"""lib3mf reads the slice stack that Druse wrote: its layers, their heights, and the area inside their outlines.

    python slices_3mf.py DRUSE FOLDER
"""

import json
import math
import pathlib
import subprocess
import sys

import lib3mf

RECIPE = """druse = 1
unit = "mm"
[band]
voxel_size = 0.25
[[op]]
union = { sphere = { radius = 5 } }
[[op]]
subtract = { cylinder = { from = [0, 0, -6], to = [0, 0, 6], radius = 2 } }
"""


def area(outlines):
    """Signed area of closed outlines."""
    total = 0.0
    for points in outlines:
        for (x1, y1), (x2, y2) in zip(points, points[1:] + points[:1]):
            total += 0.5 * (x1 * y2 - x2 * y1)
    return total


def main():
    druse, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    recipe, out = folder / "ball.toml", folder / "ball.3mf"
    recipe.write_text(RECIPE)
    command = [druse, "slice", str(recipe), "-o", str(out), "--layer", "0.5mm", "--json"]
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)

    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(out))
    assert reader.GetWarningCount() == 0, [reader.GetWarning(n) for n in range(reader.GetWarningCount())]
    stacks = model.GetSliceStacks()
    assert stacks.MoveNext(), "no slice stack"
    stack = stacks.GetCurrentSliceStack()
    count = stack.GetSliceCount()
    assert count == report["layers"] == 20, (count, report["layers"])
    volume, last = 0.0, stack.GetBottomZ()
    for n in range(count):
        layer = stack.GetSlice(n)
        vertices = [tuple(v.Coordinates) for v in layer.GetVertices()]
        outlines = []
        for k in range(layer.GetPolygonCount()):
            indices = list(layer.GetPolygonIndices(k))
            assert indices[0] == indices[-1], "an open outline"
            outlines.append([vertices[i] for i in indices[:-1]])
        volume += area(outlines) * (layer.GetZTop() - last)
        last = layer.GetZTop()
    exact = 4 / 3 * math.pi * (25 - 4) ** 1.5
    print(f"{out}: {count} slices, volume {volume:.3f}, report {report['volume']:.3f}, exact {exact:.3f}")
    assert abs(volume / report["volume"] - 1) < 1e-4
    assert abs(volume / exact - 1) < 0.02
    items = model.GetBuildItems()
    assert items.MoveNext() and items.GetCurrent().GetObjectResource().HasSlices(True)


if __name__ == "__main__":
    main()
