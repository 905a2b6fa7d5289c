"""The extension examples/blender/druse in Blender: Suzanne and a cube, sequences with velocities, Esc, motion blur.

    blender -b --factory-startup -t 2 --python-exit-code 3 --python blender_extension.py -- DRUSE FOLDER [render]
    python blender_extension.py DRUSE FOLDER [render]

The second with the package bpy of PyPI. Ran under Blender 3.4, 4.2, 4.5 and 5.0. With `render` Cycles draws a still, and
a frame of a cube that slides, with and without motion blur: its edge must widen by the way within the shutter.
"""

import os
import struct
import sys
import time
import types

import bpy
import numpy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.dont_write_bytecode = True
sys.path.insert(0, os.environ.get("DRUSE_EXTENSION") or os.path.join(HERE, "..", "..", "examples", "blender"))

import druse as extension  # noqa: E402

warned = []


def keep_warnings():
    """Records what the operator reports as warnings: those of the program, and advice."""
    found, advice = extension.runner.Run.warnings, extension.material.advice

    def advised(scene, job):
        lines = advice(scene, job)
        warned[:] = job.notes + lines
        return lines

    def recorded(run):
        lines = found(run)
        warned.extend(lines)
        return lines

    extension.material.advice, extension.runner.Run.warnings = advised, recorded


def prepared(folder, sequence=False, **changes):
    """The settings of the panel."""
    settings = bpy.context.scene.druse
    settings.cell, settings.cell_size, settings.thickness = "gyroid", 0.5, 0.1
    settings.voxel_size, settings.skin, settings.as_mesh = 0.05, 0.08, True
    settings.folder, settings.sequence = folder, sequence
    for name, value in changes.items():
        setattr(settings, name, value)
    return settings


def fill(obj, folder, sequence=False, **changes):
    """The volume and the mesh that the operator adds."""
    prepared(folder, sequence, **changes)
    bpy.context.view_layer.objects.active = obj
    before = set(bpy.data.objects)
    assert bpy.ops.druse.fill() == {"FINISHED"}
    new = [o for o in bpy.data.objects if o not in before]
    volume = next(o for o in new if o.type == "VOLUME")
    return volume, next((o for o in new if o.type == "MESH"), None)


def box_of(volume):
    """The corners of the surface in a volume, by Blender's own mesher."""
    carrier = bpy.data.objects.new("box", bpy.data.meshes.new("box"))
    bpy.context.collection.objects.link(carrier)
    modifier = carrier.modifiers.new("mesh", "VOLUME_TO_MESH")
    modifier.object, modifier.grid_name, modifier.threshold = volume, "surface", 0.0
    mesh = carrier.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    points = numpy.array([v.co for v in mesh.vertices])
    assert len(points), "no surface in the volume"
    bpy.data.objects.remove(carrier)
    return points.min(axis=0), points.max(axis=0)


def close(found, expected, tolerance, what):
    found, expected = numpy.array(found), numpy.array(expected)
    assert abs(found - expected).max() <= tolerance, f"{what}: {found}, expected {expected} within {tolerance}"


def stills(folder):
    """A closed mesh, again in the same folder, and an open one."""
    bpy.ops.mesh.primitive_cube_add(size=2.0)
    cube = bpy.context.active_object
    volume, mesh = fill(cube, os.path.join(folder, "cube"))
    assert volume.data.grids.load(), volume.data.grids.error_message
    names = sorted(grid.name for grid in volume.data.grids)
    assert names == ["density", "surface"], names
    assert volume.data.materials[0].name.startswith("Druse Volume")
    assert len(mesh.data.polygons) > 1000, len(mesh.data.polygons)
    close(mesh.dimensions, (2.0, 2.0, 2.0), 0.01, "size of the cube's mesh")
    close(numpy.subtract(*box_of(volume)[::-1]), (2.0, 2.0, 2.0), 0.01, "size of the cube's volume")
    assert not any("W103" in line for line in warned), warned
    print(f"cube: grids {names}, {len(mesh.data.polygons)} faces, {tuple(mesh.dimensions)}")

    cube.scale.z = 0.5
    bpy.context.view_layer.update()
    again, _ = fill(cube, os.path.join(folder, "cube"))
    assert sorted(os.listdir(os.path.join(folder, "cube"))) == ["Cube", "Cube.001"]
    for shown, height in ((volume, 2.0), (again, 1.0)):
        close(numpy.subtract(*box_of(shown)[::-1]), (2.0, 2.0, height), 0.01, "size of a volume beside another")

    # Suzanne's neck and eyes are open: it is filled all the same, and the user hears of it.
    bpy.ops.mesh.primitive_monkey_add(size=2.0)
    suzanne = bpy.context.active_object
    volume, mesh = fill(suzanne, os.path.join(folder, "suzanne"), cell_size=0.3, thickness=0.08, voxel_size=0.04)
    assert any("W103" in line and "42 of 1473 edges are open" in line for line in warned), warned
    corners = numpy.array([v.co for v in suzanne.data.vertices])
    shift = 0.02 if bpy.app.version < (5, 0, 0) else 0.0  # half a voxel: Blender's mesher before 5.0
    for n, side in enumerate((corners.min(axis=0), corners.max(axis=0))):
        close(box_of(volume)[n] - shift, side, 0.02, "corner of Suzanne's volume")
    points = numpy.array([v.co for v in mesh.data.vertices])
    close([points.min(axis=0), points.max(axis=0)], [corners.min(axis=0), corners.max(axis=0)], 0.02, "Suzanne's mesh")
    print(f"Suzanne: {len(mesh.data.polygons)} faces, {len(warned)} warnings, the first {warned[0][:60]}...")
    return volume


def beside(volume, name):
    """A file in the folder of a fill."""
    return os.path.join(os.path.dirname(volume.data.filepath), name)


def cache(volume):
    """The samples of the cubes' corners, (frames, corners, 3)."""
    with open(beside(volume, "cubes.pc2"), "rb") as file:
        head = struct.unpack("<12siiffi", file.read(32))
        return numpy.frombuffer(file.read(), "<f4").reshape(head[5], head[2], 3)


def key(obj, path, values):
    """Animates a property in straight lines from frame to value."""
    bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
    for frame, value in values:
        setattr(obj, path, value)
        obj.keyframe_insert(path, frame=frame)


def sequences(folder):
    """A cube that stretches and turns, one whose faces change, and the range of frames."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 3
    bpy.ops.mesh.primitive_cube_add(size=2.0)
    cube = bpy.context.active_object
    key(cube, "scale", [(1, (1, 1, 1)), (3, (2, 1, 1))])
    key(cube, "rotation_euler", [(1, (0, 0, 0)), (3, (0, 0, numpy.pi / 2))])
    # Outside the range, where the volume has no frame to show.
    scene.frame_set(10)
    volume, _ = fill(cube, os.path.join(folder, "stretched"), True)
    assert scene.frame_current == 10
    assert any("Biased" in line for line in warned) == (bpy.app.version >= (5, 0, 0)), warned
    data = volume.data
    assert data.is_sequence and data.frame_start == 1 and data.frame_duration == 3
    assert (data.velocity_grid, data.velocity_unit) == ("vel", "SECOND"), data.velocity_grid
    frames = cache(volume)
    close(frames[2], frames[0] * (2, 1, 1) @ numpy.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]), 1e-5, "corners of cubes")
    scene.frame_set(2)
    assert data.grids.load() and "vel" in [grid.name for grid in data.grids]
    for frame, size in ((1, (2, 2, 2)), (3, (2, 4, 2))):
        scene.frame_set(frame)
        close(numpy.subtract(*box_of(volume)[::-1]), size, 0.01, f"size at frame {frame}")

    # At frame 3 a modifier doubles the faces.
    array = cube.modifiers.new("array", "ARRAY")
    key(array, "count", [(2, 1), (3, 2)])
    volume, _ = fill(cube, os.path.join(folder, "changed"), True)
    with open(beside(volume, "part.toml"), encoding="utf-8") as file:
        recipe = file.read()
    assert "vel" not in recipe and "fill" in recipe
    assert warned[0].endswith("change at frame 3: cells are made anew at every frame, and there are no velocities for "
                              "motion blur"), warned
    scene.frame_set(3)
    assert numpy.subtract(*box_of(volume)[::-1]).max() > 7.9
    print("sequences: corners of cubes follow, sizes are right, changed faces are filled anew")


def operator():
    """What Blender makes of the operator when it is invoked; its functions run on a stand-in."""
    members = {k: v for k, v in vars(extension.DRUSE_OT_fill).items() if callable(v) or k.startswith("_")}
    kept = {k: v for k, v in members.items() if not k.startswith("__")}
    stand_in = type("Operator", (), kept)()
    stand_in.reports = []
    stand_in.report = lambda kinds, text: stand_in.reports.append((set(kinds), text))
    return stand_in


def modal(folder):
    """Progress, Esc, a file that is opened meanwhile, and the end of a run."""
    bpy.ops.mesh.primitive_cube_add(size=2.0)
    events = {name: types.SimpleNamespace(type=name) for name in ("TIMER", "ESC", "MOUSEMOVE")}
    wide = {"cell_size": 0.25, "thickness": 0.04, "voxel_size": 0.009, "skin": 0.0, "as_mesh": False}
    for ending in ("ESC", "another file"):
        at = os.path.join(folder, "stopped")
        prepared(at, **wide)
        run = operator()
        assert run.begin(bpy.context), run.reports
        other = operator()
        assert not other.begin(bpy.context) and "running already" in other.reports[0][1], other.reports
        volumes = len(bpy.data.volumes)
        seen = []
        start = time.time()
        while time.time() < start + 120.0 and (not seen or seen[-1] < 0.05):
            assert run.modal(bpy.context, events["TIMER"]) == {"PASS_THROUGH"}
            assert run.modal(bpy.context, events["MOUSEMOVE"]) == {"PASS_THROUGH"}
            seen.append(run._run.progress())
            time.sleep(0.05)
        assert 0.05 <= seen[-1] < 1.0 and seen == sorted(seen), seen[-1]
        process, left, stop = run._run._process, [], run._run.cancel
        # What the program leaves, before its folder is removed.
        run._run.cancel = lambda: (stop(), left.extend(sorted(os.listdir(run._job.folder))))
        start = time.time()
        if ending == "ESC":
            assert run.modal(bpy.context, events["ESC"]) == {"CANCELLED"}
        else:
            run.cancel(bpy.context)
        took = time.time() - start
        assert process.poll() is not None and took < 10.0
        assert left == ["mesh.stl", "part.toml"], left
        assert os.listdir(at) == [], os.listdir(at)
        assert len(bpy.data.volumes) == volumes
        print(f"{ending} at {seen[-1]:.0%}: ended in {took:.2f} s, exit {process.returncode}, nothing half-made")

    # In a temporary folder nothing is left at all.
    prepared("", **wide)
    run = operator()
    assert run.begin(bpy.context) and os.path.isdir(run._job.folder)
    run.modal(bpy.context, events["ESC"])
    assert not os.path.exists(run._job.folder)

    prepared(os.path.join(folder, "modal"))
    run = operator()
    assert run.begin(bpy.context)
    while (state := run.modal(bpy.context, events["TIMER"])) == {"PASS_THROUGH"}:
        time.sleep(0.05)
    assert state == {"FINISHED"} and len(bpy.data.volumes) == volumes + 1, (state, run.reports)


def errors(folder):
    """A program that is not there, and a recipe that it refuses."""
    named = extension.program_of
    for program, voxel, words in (("/nowhere/druse", 0.05, "set its path"), (None, 1e-6, "error")):
        prepared(os.path.join(folder, "errors"), voxel_size=voxel)
        if program:
            extension.program_of = lambda _context: program
        try:
            bpy.ops.druse.fill()
        except RuntimeError as error:
            assert words in str(error), error
        else:
            raise AssertionError(f"no error: {words}")
        extension.program_of = named
    prepared("//fills")
    try:
        bpy.ops.druse.fill()
    except RuntimeError as error:
        assert "save it first" in str(error), error
    else:
        raise AssertionError("no error: a folder beside a file that was never saved")


def stage(width, height, samples):
    """Cycles with a sun behind the camera and no other light."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.device, scene.cycles.use_denoising = samples, "CPU", False
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.view_settings.view_transform = "Raw"
    scene.world = bpy.data.worlds.new("world")
    if bpy.app.version < (5, 0, 0):
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy = 20.0
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    for obj in (sun, camera):
        bpy.context.collection.objects.link(obj)
    scene.camera = camera
    return camera, sun


def render(volume, picture):
    """The red of one frame's pixels, rows from below."""
    scene = bpy.context.scene
    for obj in bpy.data.objects:
        obj.hide_render = obj.type in ("MESH", "VOLUME") and obj is not volume
    scene.render.filepath = picture
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(picture)
    width, height = image.size
    return numpy.array(image.pixels[:]).reshape(height, width, 4)[:, :, 0]


def edges(row, width):
    """The 10 to 90 % widths of the soft edges at both ends of a bright row of pixels."""
    middle = len(row) // 2
    plateau = row[middle - 10 : middle + 10].mean()

    def soft(half):
        below = numpy.flatnonzero(half < 0.1 * plateau)[-1]
        above = numpy.flatnonzero(half > 0.9 * plateau)[0]
        low = below + (0.1 * plateau - half[below]) / (half[below + 1] - half[below])
        high = above - 1 + (0.9 * plateau - half[above - 1]) / (half[above] - half[above - 1])
        return round(float(high - low) * width / len(row), 4)

    return soft(row[:middle]), soft(row[middle:][::-1])


def pictures(suzanne, folder):
    """Suzanne is seen; a cube that slides by 0.8 m a frame under a shutter of half a frame has edges of 0.4 m."""
    scene = bpy.context.scene
    camera, sun = stage(160, 160, 16)
    scene.frame_set(1)
    camera.location, camera.rotation_euler = (0.0, -6.0, 0.0), (numpy.pi / 2, 0.0, 0.0)
    sun.rotation_euler = (0.9, 0.3, 0.0)
    pixels = render(suzanne, os.path.join(folder, "suzanne.png"))
    assert pixels.max() - pixels.min() > 0.2, "the picture is flat"

    # A plate out of sight makes the volume longer, so that blur beside the cube is inside its box.
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(0.0, 0.0, -0.7), scale=(2.0, 1.0, 0.2))
    plate = bpy.context.active_object
    bpy.ops.mesh.primitive_cube_add(size=1.0)
    cube = bpy.context.active_object
    with bpy.context.temp_override(active_object=cube, selected_editable_objects=[cube, plate]):
        bpy.ops.object.join()
    key(cube, "location", [(1, (-0.8, 0, 0)), (3, (0.8, 0, 0))])
    scene.render.motion_blur_shutter = 0.5
    settings = {"cell_size": 0.5, "thickness": 0.08, "voxel_size": 0.02, "as_mesh": False}
    volume, _ = fill(cube, os.path.join(folder, "sliding"), True, **settings)
    scene.frame_set(2)
    camera.data.type, camera.data.ortho_scale = "ORTHO", 2.0
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 120, 30, 48
    sun.rotation_euler = camera.rotation_euler
    if hasattr(scene.cycles, "volume_biased"):
        # The way that Blender 5.0 works by default leaves out what moves beyond the still volume.
        scene.cycles.volume_biased = True
    widths = []
    for blur in (False, True):
        scene.render.use_motion_blur = blur
        pixels = render(volume, os.path.join(folder, f"sliding_{'blur' if blur else 'sharp'}.png"))
        widths.append(edges(pixels.mean(axis=0), 2.0))
    print(f"edges of the sliding cube: sharp {widths[0]}, with motion blur {widths[1]}, expected 0.32")
    assert max(widths[0]) < 0.05, widths
    close(widths[1], (0.32, 0.32), 0.02, "width of blurred edges, 10 to 90 %")


def main():
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    program, folder = os.path.abspath(arguments[0]), os.path.abspath(arguments[1])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    extension.register()
    extension.program_of = lambda _context: program
    keep_warnings()
    suzanne = stills(folder)
    sequences(folder)
    modal(folder)
    errors(folder)
    if "render" in arguments[2:]:
        pictures(suzanne, folder)
    extension.unregister()
    extension.register()
    extension.unregister()
    print("blender", bpy.app.version_string, "passes")


if __name__ == "__main__":
    main()
