"""Blender without a window, without anyone's preferences, with the add-on registered and an empty file for every test."""

import importlib.util
import os
import tempfile

import numpy as np
import pytest

if importlib.util.find_spec("bpy") is None:
    collect_ignore_glob = ["test_*.py"]
else:
    # Before bpy is imported: the developer's own preferences would be read otherwise.
    os.environ.setdefault("BLENDER_USER_RESOURCES", tempfile.mkdtemp(prefix="blender-user-"))

QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


class FakeSolution:
    """Light that is known everywhere: a linear function of the place, with a step from polygon to polygon."""

    SLOPE = np.array([[0.3, 0.6, 0.9], [0.5, 1.0, 1.5], [0.7, 1.4, 2.1]])

    def __init__(self, step=0.0):
        self.step = step
        self.report = {"rooms": 1, "unshot_fraction": 0.001, "seconds": {"solve": 0.5}}

    def irradiance(self, points, polygon):
        return self.light(points, polygon)

    def shows(self, points, polygon):
        return np.ones(len(points), bool)

    def light(self, points, polygon):
        return (np.asarray(points) + 20.0) @ self.SLOPE + self.step * np.asarray(polygon)[:, None]


class Workshop:
    """Builds small scenes in the open file and bakes them."""

    def __init__(self):
        import bpy

        self.bpy = bpy

    def collection(self, name, parent=None):
        made = self.bpy.data.collections.new(name)
        (parent or self.bpy.context.scene.collection).children.link(made)
        return made

    def mesh(self, vertices, faces, name="Thing", collection=None, material=None):
        data = self.bpy.data.meshes.new(name)
        data.from_pydata([tuple(map(float, v)) for v in vertices], [], [tuple(map(int, f)) for f in faces])
        thing = self.bpy.data.objects.new(name, data)
        (collection or self.bpy.context.scene.collection).objects.link(thing)
        if material is not None:
            data.materials.append(material)
        return thing

    def box(self, low, high, name="Box", inward=True, leave_out=(), **more):
        """A box; the order of its faces is x-, x+, y-, y+, z-, z+."""
        low, high = np.asarray(low, float), np.asarray(high, float)
        vertices = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
        quads = np.delete(QUADS, list(leave_out), axis=0)
        return self.mesh(vertices, quads[:, ::-1] if inward else quads, name, **more)

    def material(self, name="Paint", color=(0.5, 0.5, 0.5), emission=0.0, emission_color=(1, 1, 1)):
        made = self.bpy.data.materials.new(name)
        if made.node_tree is None:
            made.use_nodes = True
        node = next(n for n in made.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
        node.inputs["Base Color"].default_value = (*color, 1.0)
        node.inputs["Emission Color"].default_value = (*emission_color, 1.0)
        node.inputs["Emission Strength"].default_value = emission
        return made

    def two_rooms(self, wall=0.2):
        """Two boxes with a door in the wall between them and a lamp in the first; returns the objects by name."""
        rooms, portals = self.collection("Rooms"), self.collection("Portals")
        made = {}
        x = 4.0 + wall
        for name, low, high, door in (("West", (0, 0, 0), (4, 3, 2.5), 4.0), ("East", (x, 0, 0), (x + 3, 3, 2.5), x)):
            home = self.collection(name, rooms)
            side = 1 if name == "West" else 0
            paint = self.material(f"{name} paint", (0.7, 0.6, 0.5))
            made[name] = self.box(low, high, f"{name} walls", collection=home, leave_out=[side], material=paint)
            vertices = [(door, y, z) for y in range(4) for z in (0, 2, 2.5)]
            faces = [(0, 3, 4, 1), (1, 4, 5, 2), (4, 7, 8, 5), (6, 9, 10, 7), (7, 10, 11, 8)]
            faces = faces if side == 0 else [f[::-1] for f in faces]
            made[f"{name} door wall"] = self.mesh(vertices, faces, f"{name} door wall", home, paint)
        lamp = self.material("Lamp", (0.5, 0.5, 0.5), 10.0)
        home = rooms.children["West"]
        made["Lamp"] = self.mesh([(1, 1, 2.4), (1, 2, 2.4), (2, 2, 2.4), (2, 1, 2.4)], [(0, 1, 2, 3)], "Lamp", home, lamp)
        middle = 4.0 + wall / 2
        made["Door"] = self.mesh([(middle, 1, 0), (middle, 2, 0), (middle, 2, 2), (middle, 1, 2)], [(0, 1, 2, 3)], "Door", portals)
        self.bpy.context.view_layer.update()
        return made

    def extract(self):
        from enfilade.addon.extract import extract

        self.bpy.context.view_layer.update()
        return extract(self.bpy.context)

    def bake(self, step=0.0, solver=None, options=None, **bake):
        """Bake with light that is known; returns what was read, computed and written."""
        from enfilade.addon import job
        from enfilade.core.options import BakeOptions, Options

        def known(scene, options):
            yield job.Step("solve", 0.5, "")
            return FakeSolution(step)

        self.bpy.context.view_layer.update()
        reading = job.read(self.bpy.context, options or Options(), BakeOptions(**bake))
        baked = job.solve_all(reading, None, solver or known)
        return reading, baked, job.write(self.bpy.context, reading, baked)

    def colors(self, thing, name="Enfilade"):
        """(N, 4) colours of an attribute."""
        data = thing.data.color_attributes[name].data
        out = np.zeros(4 * len(data), np.float32)
        data.foreach_get("color", out)
        return out.reshape(-1, 4)

    def light(self, points):
        """(.., 3) irradiance of the light that :meth:`bake` takes as known, where it has no steps."""
        return (np.asarray(points) + 20.0) @ FakeSolution.SLOPE

    def pixels(self, image):
        """(H, W, 4) values of an image, row 0 at the bottom."""
        out = np.zeros(image.size[0] * image.size[1] * 4, np.float32)
        image.pixels.foreach_get(out)
        return out.reshape(image.size[1], image.size[0], 4)

    def lightmap(self, thing, name="Enfilade UV"):
        """(C, 2) coordinates in the lightmap."""
        return np.array([d.vector for d in thing.data.uv_layers[name].uv])

    def corners(self, thing):
        """(C, 3) world positions of the corners of an object's own mesh."""
        at = np.array([v.co for v in thing.data.vertices]) @ np.array(thing.matrix_world)[:3, :3].T + np.array(thing.matrix_world)[:3, 3]
        return at[[loop.vertex_index for loop in thing.data.loops]]

    def state(self):
        """All that a user could miss or find too much: names, flags and data of everything in the file."""
        data = self.bpy.data
        return {
            "objects": sorted((o.name, o.data.name if o.data else "", o.hide_render, o.hide_viewport, o.hide_get()) for o in data.objects),
            "slots": sorted((o.name, [(s.link, s.material.name if s.material else "") for s in o.material_slots]) for o in data.objects),
            "collections": sorted((c.name, sorted(c.objects.keys()), c.hide_viewport) for c in data.collections),
            "meshes": sorted(
                (
                    m.name,
                    m.users,
                    sorted((a.name, a.data_type, a.domain) for a in m.attributes if not a.name.startswith(".")),
                    m.attributes.active_color_name or "",
                    m.attributes.default_color_name or "",
                    m.uv_layers.active.name if m.uv_layers.active else "",
                    [layer.name for layer in m.uv_layers if layer.active_render],
                )
                for m in data.meshes
            ),
            "materials": sorted((m.name, m.users, len(m.node_tree.nodes)) for m in data.materials),
            "images": sorted(i.name for i in data.images),
            "cameras": sorted(c.name for c in data.cameras),
        }


@pytest.fixture(scope="session")
def _registered():
    import enfilade

    enfilade.register()
    yield
    enfilade.unregister()


@pytest.fixture
def shop(_registered):
    """A workshop with an empty file open."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    return Workshop()
