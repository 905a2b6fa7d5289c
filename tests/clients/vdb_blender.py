"""A .vdb file in Blender: load, mesh, measure, render.

    blender -b --factory-startup -t 2 --python-exit-code 3 --python vdb_blender.py -- FILE.vdb OUT.png [REPORT.json]

Prints what Blender finds as one JSON object. Any failed expectation ends Blender with exit code 3. With the report of
the run, volume and box are compared with it.
"""

import json
import math
import os
import sys

import bmesh
import bpy
from mathutils import Vector

METRES = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "ft": 0.3048}


def load(path):
    """The file as a volume object."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.object.volume_import(filepath=os.path.abspath(path))
    volume = bpy.context.object
    assert volume.data.grids.load(), volume.data.grids.error_message
    names = [grid.name for grid in volume.data.grids]
    assert "surface" in names, f"grids {names}"
    # Blender turns what Houdini wrote; ours must stay as it is.
    assert tuple(volume.rotation_euler) == (0.0, 0.0, 0.0), tuple(volume.rotation_euler)
    return volume


def mesh_of(volume):
    """The zero set as an object with a Volume to Mesh modifier."""
    carrier = bpy.data.objects.new("part", bpy.data.meshes.new("part"))
    bpy.context.collection.objects.link(carrier)
    modifier = carrier.modifiers.new("mesh", "VOLUME_TO_MESH")
    modifier.object = volume
    modifier.grid_name = "surface"
    modifier.threshold = 0.0
    modifier.adaptivity = 0.0
    modifier.use_smooth_shade = True
    return carrier


def measure(carrier, voxel_size):
    """Volume, open and non-manifold edges and box of the evaluated mesh, in the file's unit."""
    mesh = carrier.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    work = bmesh.new()
    work.from_mesh(mesh)
    # Volume to Mesh of Blender before 5.0 is shifted by half a voxel on every axis.
    shift = voxel_size / 2 if bpy.app.version < (5, 0, 0) else 0.0
    corners = [[pick(v.co[a] for v in work.verts) - shift for a in range(3)] for pick in (min, max)]
    found = {
        "vertices": len(work.verts),
        "faces": len(work.faces),
        "volume": abs(work.calc_volume(signed=True)),
        "non_manifold_edges": sum(not edge.is_manifold for edge in work.edges),
        "box": corners,
    }
    work.free()
    return found


def render(carrier, corners, out):
    """A picture by Cycles on the CPU."""
    low, high = Vector(corners[0]), Vector(corners[1])
    centre, radius = (low + high) / 2, (high - low).length / 2
    scene = bpy.context.scene
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    direction = Vector((-0.55, -1.0, 0.62)).normalized()
    camera.location = centre + direction * radius / math.sin(math.radians(15))
    camera.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
    camera.data.angle = math.radians(30)
    camera.data.clip_start, camera.data.clip_end = 0.1 * radius, 100 * radius
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy = 4.0
    sun.rotation_euler = (math.radians(40), 0, math.radians(-60))
    for thing in (camera, sun):
        bpy.context.collection.objects.link(thing)
    world = bpy.data.worlds.new("world")
    world.color = (0.25, 0.27, 0.3)
    scene.world, scene.camera = world, camera
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = 8
    scene.cycles.use_denoising = False  # Debian's Blender has no denoiser
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    scene.render.filepath = os.path.abspath(out)
    bpy.ops.render.render(write_still=True)
    assert os.path.getsize(out) > 10_000, "the picture is empty"
    # Something must be seen: the middle and the corner differ.
    image = bpy.data.images.load(os.path.abspath(out))
    assert len({round(v, 2) for v in image.pixels[:][::397]}) > 5, "the picture is of one colour"


def against_report(found, voxel_size, unit, report):
    factor = METRES[report["unit"]] / METRES[unit]
    volume = report["solid"]["volume"] * factor**3
    off = abs(found["volume"] / volume - 1)
    assert off < 0.005, f"volume {found['volume']} differs from the report's {volume} by {100 * off:.2f} %"
    centre = [sum(c[a] for c in found["box"]) / 2 for a in range(3)]
    ours = [sum(c[a] for c in report["solid"]["box"]) / 2 * factor for a in range(3)]
    worst = max(abs(a - b) for a, b in zip(centre, ours)) / voxel_size
    assert worst < 0.5, f"the box's centre is {worst:.2f} voxels off"


def main():
    path, out, *report = sys.argv[sys.argv.index("--") + 1 :]
    volume = load(path)
    grid = next(g for g in volume.data.grids if g.name == "surface")
    voxel_size = grid.matrix_object[0][0]
    carrier = mesh_of(volume)
    found = measure(carrier, voxel_size)
    assert found["faces"] > 0, "the mesh is empty"
    assert found["non_manifold_edges"] == 0, f"{found['non_manifold_edges']} non-manifold edges"
    if report:
        with open(report[0]) as file:
            ours = json.load(file)
        name = os.path.basename(path)
        unit = next(o["unit"] for o in ours["outputs"] if os.path.basename(o["path"]) == name)
        against_report(found, voxel_size, unit, ours)
    volume.hide_render = True
    render(carrier, found["box"], out)
    print(json.dumps({"blender": bpy.app.version_string, "voxel_size": voxel_size, **found}, indent=1))


main()
