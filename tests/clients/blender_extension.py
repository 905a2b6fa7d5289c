"""The extension examples/blender/druse in Blender: fills a cube, as a still and as a sequence of a stretched one.

    blender -b --factory-startup -t 2 --python-exit-code 3 --python blender_extension.py -- DRUSE FOLDER [OUT.png]

Runs under Blender 3.4 and newer, and with the module bpy as a plain Python program. With OUT.png also renders one
frame of the volume in Cycles, and expects it to be seen.
"""

import os
import sys

import bpy

FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "examples", "blender")


def fill(folder, sequence):
    """The objects that the operator adds."""
    settings = bpy.context.scene.druse
    settings.cell, settings.cell_size, settings.thickness = "gyroid", 0.5, 0.1
    settings.voxel_size, settings.skin = 0.04, 0.05
    settings.folder, settings.sequence = folder, sequence
    before = set(bpy.data.objects)
    assert bpy.ops.druse.fill() == {"FINISHED"}
    return [o for o in bpy.data.objects if o not in before]


def box_of(volume):
    """Size of the active voxels of a volume's fog along x, by its evaluated mesh."""
    carrier = bpy.data.objects.new("box", bpy.data.meshes.new("box"))
    bpy.context.collection.objects.link(carrier)
    modifier = carrier.modifiers.new("mesh", "VOLUME_TO_MESH")
    modifier.object, modifier.grid_name, modifier.threshold = volume, "surface", 0.0
    mesh = carrier.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    xs = [v.co.x for v in mesh.vertices]
    assert xs, "no surface in the volume"
    width = max(xs) - min(xs)
    bpy.data.objects.remove(carrier)
    return width


def render(volume, picture):
    """One frame in Cycles; returns the spread of its pixels."""
    scene = bpy.context.scene
    for obj in list(bpy.data.objects):
        if obj is not volume and obj.type == "MESH":
            obj.hide_render = True
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.device, scene.cycles.use_denoising = 16, "CPU", False
    scene.render.resolution_x = scene.render.resolution_y = 160
    scene.render.filepath = picture
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.3
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 4.0, (0.6, 0.3, 0.0)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.rotation_euler = (3.2, -3.2, 2.4), (1.08, 0.0, 0.785)
    for obj in (sun, camera):
        bpy.context.collection.objects.link(obj)
    scene.camera = camera
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(picture)
    values = list(image.pixels)[::4]
    return max(values) - min(values)


def main():
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    druse, folder = arguments[0], os.path.abspath(arguments[1])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    sys.path.insert(0, FOLDER)
    import druse as extension

    extension.register()
    extension.program_of = lambda _context: os.path.abspath(druse)
    bpy.ops.mesh.primitive_cube_add(size=2.0)
    cube = bpy.context.active_object
    new = fill(os.path.join(folder, "still"), False)
    volume = next(o for o in new if o.type == "VOLUME")
    mesh = next(o for o in new if o.type == "MESH")
    assert volume.data.grids.load(), volume.data.grids.error_message
    names = sorted(grid.name for grid in volume.data.grids)
    assert names == ["density", "surface"], names
    assert volume.data.materials[0].name == "Druse Volume"
    assert len(mesh.data.polygons) > 1000, len(mesh.data.polygons)
    for axis in range(3):
        assert abs(mesh.dimensions[axis] - 2.0) < 0.1, tuple(mesh.dimensions)
    print(f"still: grids {names}, {len(mesh.data.polygons)} faces, {tuple(mesh.dimensions)}")
    if len(arguments) > 2:
        spread = render(volume, os.path.abspath(arguments[2]))
        assert spread > 0.2, f"the picture is flat: {spread}"
        print(f"rendered, pixels spread over {spread:.2f}")

    # A cube whose length doubles from frame 1 to 3.
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 3
    for frame, scale in ((1, 1.0), (3, 2.0)):
        cube.scale.x = scale
        cube.keyframe_insert("scale", frame=frame)
    bpy.context.view_layer.objects.active = cube
    new = fill(os.path.join(folder, "sequence"), True)
    volume = next(o for o in new if o.type == "VOLUME")
    assert volume.data.is_sequence and volume.data.frame_duration == 3
    widths = []
    for frame in (1, 3):
        scene.frame_set(frame)
        widths.append(box_of(volume))
    assert abs(widths[1] / widths[0] - 2.0) < 0.1, widths
    print(f"sequence: width {widths[0]:.3f} at frame 1, {widths[1]:.3f} at frame 3")

    # A program that is not there is an error with advice.
    extension.program_of = lambda _context: "/nowhere/druse"
    bpy.context.view_layer.objects.active = cube
    try:
        bpy.ops.druse.fill()
    except RuntimeError as error:
        assert "set its path" in str(error), error
    else:
        raise AssertionError("no error without the program")
    extension.unregister()
    print("blender", bpy.app.version_string, "passes")


if __name__ == "__main__":
    main()
