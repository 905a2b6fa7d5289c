# SPDX-License-Identifier: MIT OR Apache-2.0
"""Druse in Blender: fills the active mesh with a microstructure and brings back a volume and a mesh.

The operator writes the mesh and a recipe into a folder, runs the program `druse` beside Blender, and imports what it
writes. It needs the program alone: its path is a preference. Lengths in the panel are scene units, read as metres.
"""

import bpy

from . import material, recipe, runner

bl_info = {
    "name": "Druse",
    "author": "The Druse developers",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "3D View > Sidebar > Druse",
    "description": "Fill a mesh with a microstructure",
    "category": "Mesh",
}


class DrusePreferences(bpy.types.AddonPreferences):
    """Where the program is."""

    bl_idname = __package__

    program: bpy.props.StringProperty(
        name="Program", description="Path of druse; empty for the one on PATH", subtype="FILE_PATH"
    )

    def draw(self, _context):
        self.layout.prop(self, "program")


class DruseSettings(bpy.types.PropertyGroup):
    """What the panel shows."""

    cell: bpy.props.EnumProperty(name="Cell", items=recipe.CELLS, default="gyroid")
    cell_size: bpy.props.FloatProperty(name="Size", description="Edge of a cell", default=0.4, min=1e-6, unit="LENGTH")
    thickness: bpy.props.FloatProperty(
        name="Thickness", description="Of sheets and struts", default=0.06, min=1e-6, unit="LENGTH"
    )
    skin: bpy.props.FloatProperty(
        name="Skin", description="Thickness of a solid skin; 0 for none", default=0.0, min=0.0, unit="LENGTH"
    )
    voxel_size: bpy.props.FloatProperty(
        name="Voxel", description="Edge of a voxel", default=0.02, min=1e-6, unit="LENGTH"
    )
    as_volume: bpy.props.BoolProperty(name="Volume", default=True)
    as_mesh: bpy.props.BoolProperty(name="Mesh", default=True)
    sequence: bpy.props.BoolProperty(
        name="Sequence",
        description="Every frame of the scene, with the mesh as it is deformed there, and velocities for motion blur",
    )
    folder: bpy.props.StringProperty(
        name="Folder",
        description="Where files stay, in a new folder per fill; empty for a temporary one",
        subtype="DIR_PATH",
    )


def program_of(context):
    """The program that the preferences name."""
    addon = context.preferences.addons.get(__package__)
    return (addon.preferences.program if addon else "") or "druse"


class DRUSE_OT_fill(bpy.types.Operator):
    """Fill the active mesh with the cell"""

    bl_idname = "druse.fill"
    bl_label = "Fill"
    bl_options = {"REGISTER", "UNDO"}

    # Runs of two operators could write the same files.
    _is_busy = False
    _timer = None
    _run = None

    @classmethod
    def poll(cls, context):
        return context.active_object is not None and context.active_object.type == "MESH"

    def begin(self, context):
        """Writes the files and starts the program; whether it runs."""
        if DRUSE_OT_fill._is_busy:
            self.report({"ERROR"}, "Druse is running already; Esc stops it")
            return False
        try:
            self._name = context.active_object.name
            self._job = recipe.write(context, context.active_object, context.scene.druse)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, str(error))
            return False
        try:
            self._run = runner.Run(program_of(context), self._job)
        except OSError as error:
            self._job.discard()
            self.report({"ERROR"}, str(error))
            return False
        DRUSE_OT_fill._is_busy = True
        return True

    def invoke(self, context, _event):
        if not self.begin(context):
            return {"CANCELLED"}
        manager = context.window_manager
        manager.progress_begin(0, 100)
        self._timer = manager.event_timer_add(0.2, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC":
            self.cancel(context)
            self.report({"INFO"}, "Druse was stopped")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        context.window_manager.progress_update(int(100 * self._run.progress()))
        if context.workspace:
            percent = int(100 * self._run.progress())
            context.workspace.status_text_set(f"Druse: {percent} %, {self._run.stage()} (Esc stops)")
        if not self._run.is_done():
            return {"PASS_THROUGH"}
        self.finish(context)
        return self.collect(context)

    def execute(self, context):
        """Without a window: waits for the program."""
        if not self.begin(context):
            return {"CANCELLED"}
        self._run.wait()
        DRUSE_OT_fill._is_busy = False
        return self.collect(context)

    def cancel(self, context):
        """Ends the program; Blender calls this too when it opens another file or quits."""
        self._run.cancel()
        self.finish(context)
        self._job.discard()

    def collect(self, context):
        error = self._run.error()
        if error:
            if self._job.is_temporary:
                self._job.discard()
            self.report({"ERROR"}, error)
            return {"CANCELLED"}
        material.bring_in(context, self._job, self._name)
        for note in self._job.notes + material.advice(context.scene, self._job) + self._run.warnings():
            self.report({"WARNING"}, note)
        if self._job.is_temporary:
            self.report({"INFO"}, f"Files are in {self._job.folder}; set a folder to keep them")
        return {"FINISHED"}

    def finish(self, context):
        DRUSE_OT_fill._is_busy = False
        manager = context.window_manager
        if self._timer:
            manager.event_timer_remove(self._timer)
            self._timer = None
        manager.progress_end()
        if context.workspace:
            context.workspace.status_text_set(None)


class DRUSE_PT_panel(bpy.types.Panel):
    """The panel in the sidebar"""

    bl_idname = "DRUSE_PT_panel"
    bl_label = "Druse"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Druse"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        settings = context.scene.druse
        for name in ("cell", "cell_size", "thickness", "skin", "voxel_size", "as_volume", "as_mesh", "sequence", "folder"):
            layout.prop(settings, name)
        layout.operator(DRUSE_OT_fill.bl_idname)


CLASSES = (DrusePreferences, DruseSettings, DRUSE_OT_fill, DRUSE_PT_panel)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.druse = bpy.props.PointerProperty(type=DruseSettings)


def unregister():
    del bpy.types.Scene.druse
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
