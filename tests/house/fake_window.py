"""What stands in for a window of Blender, which the module has none of."""


class FakeWindow:
    """What a modal operator asks of a context with a window."""

    def __init__(self, bpy):
        self._context = bpy.context
        self.scene, self.view_layer = bpy.context.scene, bpy.context.view_layer
        self.evaluated_depsgraph_get = bpy.context.evaluated_depsgraph_get
        self.status = "?"
        self.window_manager = self
        self.workspace = self
        self.window = None
        self.windows = []
        self.handlers = []
        self.enfilade_shading = ""

    def event_timer_add(self, seconds, window):
        return "timer"

    def event_timer_remove(self, timer):
        self.handlers.clear()

    def modal_handler_add(self, operator):
        self.handlers.append(operator)

    def progress_begin(self, low, high): ...

    def progress_update(self, value): ...

    def progress_end(self): ...

    def status_text_set(self, text):
        self.status = text


class Event:
    def __init__(self, kind, value="NOTHING"):
        self.type, self.value = kind, value
