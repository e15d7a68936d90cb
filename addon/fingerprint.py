# SPDX-License-Identifier: GPL-3.0-or-later
"""A fingerprint of all that the light of a scene depends on, to tell whether a bake is still that of its scene.

It is made from Blender's own data and not from an extraction: nothing is evaluated, so that it costs some milliseconds. What a
bake itself changes (attributes, UV maps, materials in place of others, hidden originals) does not count.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator

import bpy
import numpy as np

from ..core.options import BakeOptions, Options
from .fine_mesh import COLLECTION
from .membership import rendered_objects
from .mesh_arrays import bulk
from .roles import chosen_collections, portal_objects

_IDLE = ("threads", "store", "memory", "ordering")
"""Options that change no light."""

_SURFACES = ("MESH", "CURVE", "SURFACE", "META", "FONT", "LIGHT")

_PLAIN = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}
_LOOKS = {"name", "name_full", "select", "use_fake_user", "users", "tag", "is_library_indirect", "is_missing", "is_runtime_data",
          "is_embedded_data", "is_evaluated", "is_editmode", "show_expanded", "show_viewport", "show_in_editmode", "show_on_cage",
          "is_active", "execution_time", "use_pin_to_last", "persistent_uid", "session_uid", "use_nodes"}  # fmt: skip
"""Properties that only say how something looks in an editor, or that Blender counts."""

_NODE_LOOKS = frozenset(("location", "location_absolute", "width", "height", "dimensions", "color", "use_custom_color", "label", "hide",
                         "show_options", "show_preview", "show_texture", "is_active_output", "warning_propagation",
                         "bl_idname", "bl_label"))  # fmt: skip


def fingerprint(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, options: Options, bake: BakeOptions) -> str:
    """The fingerprint as a text; equal for scenes and options that give the same bake."""
    steps = fingerprinting(scene, view_layer, options, bake)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def fingerprinting(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, options: Options, bake: BakeOptions) -> Iterator[None]:
    """As :func:`fingerprint`, object by object, for a window that must stay alive. Objects may not be removed in between."""
    whole = hashlib.blake2b(digest_size=16)
    seen: dict[bpy.types.ID, bytes] = {}
    that_matter = {f.name: getattr(options, f.name) for f in dataclasses.fields(options) if f.name not in _IDLE}
    whole.update(repr((scene.unit_settings.scale_length, that_matter, bake)).encode())
    objects = _all_objects(scene, view_layer)
    whole.update(_members(scene, set(objects)))
    if scene.world is not None:
        whole.update(_once(scene.world, seen))
    for thing in objects:
        whole.update(_object(thing, seen))
        yield
    return whole.hexdigest()


def _all_objects(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> list[bpy.types.Object]:
    """What takes part, the portals, and what instances show, each once."""
    found = dict.fromkeys(rendered_objects(view_layer))
    found.update(dict.fromkeys(portal_objects(scene)))
    for thing in list(found):
        if thing.instance_type == "COLLECTION" and thing.instance_collection is not None:
            found.update(dict.fromkeys(thing.instance_collection.all_objects))
    return [thing for thing in found if thing.type in _SURFACES or thing.instance_type != "NONE"]


def _members(scene: bpy.types.Scene, objects: set[bpy.types.Object]) -> bytes:
    """The collections with what of ``objects`` lies in each, and which are rooms and portals."""
    rooms, portals = chosen_collections(scene)
    tree = []
    for collection in (scene.collection, *scene.collection.children_recursive):
        inside = [thing.name for thing in collection.objects if thing in objects]
        children = [child.name for child in collection.children if child.name != COLLECTION]
        if inside or children:
            own = getattr(collection, "enfilade", None)
            tree.append((collection.name, children, inside, _plain(own) if own is not None else b""))
    return repr((_name(rooms), _name(portals), tree)).encode()


def _object(thing: bpy.types.Object, seen: dict) -> bytes:
    tags = thing.enfilade
    parts = [thing.name.encode(), thing.instance_type.encode()]
    holder = thing
    while holder is not None:  # not the matrix in the world, which is stale for what is hidden
        parts += [np.array(matrix, np.float32).tobytes() for matrix in (holder.matrix_basis, holder.matrix_parent_inverse)]
        parts += [_plain(constraint) for constraint in holder.constraints]
        holder = holder.parent
    own = (tags.by_hand, _name(tags.behind), _name(tags.in_front), tags.transmittance, tags.texel_scale)
    parts.append(repr((*own, _name(thing.instance_collection))).encode())
    parts += [_plain(modifier) for modifier in thing.modifiers]
    if thing.data is not None:
        parts.append(_once(thing.data, seen))
    for slot in thing.material_slots:
        material = slot.material
        if material is not None and material.enfilade.made:
            if material.enfilade.new_slot:
                continue
            material = material.enfilade.stands_for
        parts.append(_once(material, seen) if material is not None else b"none")
        if isinstance(thing.data, bpy.types.Mesh) and _shows_images(material):
            parts.append(_once_uv(thing.data, seen))
    return b"|".join(parts)


def _shows_images(material: bpy.types.Material | None) -> bool:
    tree = material.node_tree if material is not None else None
    return tree is not None and any(node.type == "TEX_IMAGE" for node in tree.nodes)


def _once_uv(mesh: bpy.types.Mesh, seen: dict) -> bytes:
    """The UV maps of a mesh but that of a bake."""
    key = (mesh, "UV")
    if key not in seen:
        whole = hashlib.blake2b(digest_size=16)
        for layer in mesh.uv_layers:
            if layer.name != mesh.enfilade.uv_map:
                whole.update(repr((layer.name, layer.active_render)).encode() + bulk(layer.uv, "vector", np.float32, 2).tobytes())
        seen[key] = whole.digest()
    return seen[key]


def _once(data: bpy.types.ID, seen: dict) -> bytes:
    if data not in seen:
        parts = [_mesh(data)] if isinstance(data, bpy.types.Mesh) else [_plain(data), *_splines(data)]
        tree = getattr(data, "node_tree", None)
        # Touching use_nodes warns from Blender 5.0 on, where all that has nodes uses them.
        if tree is not None and (bpy.app.version >= (5, 0) or data.use_nodes):
            parts.append(_nodes(tree))
        seen[data] = hashlib.blake2b(b"|".join(parts), digest_size=16).digest()
    return seen[data]


def _mesh(mesh: bpy.types.Mesh) -> bytes:
    """Positions, faces and the slots of their materials. In edit mode what was there before."""
    sharp = mesh.attributes.get("sharp_edge")
    parts = [
        bulk(mesh.vertices, "co", np.float32, 3),
        bulk(mesh.loops, "vertex_index", np.int32),
        bulk(mesh.polygons, "loop_start", np.int32),
        bulk(mesh.polygons, "material_index", np.int32),
    ]
    if sharp is not None and sharp.domain == "EDGE" and len(sharp.data) == len(mesh.edges):
        parts.append(bulk(sharp.data, "value", bool))
    keys = mesh.shape_keys
    values = [(block.name, block.value, block.mute) for block in keys.key_blocks] if keys is not None else []
    return b"|".join([*(part.tobytes() for part in parts), repr(values).encode()])


def _splines(data: bpy.types.ID) -> list[bytes]:
    parts = []
    for spline in getattr(data, "splines", ()):
        for points, keys in ((spline.points, (("co", 4),)), (spline.bezier_points, (("co", 3), ("handle_left", 3), ("handle_right", 3)))):
            parts += [bulk(points, key, np.float32, width).tobytes() for key, width in keys]
    return parts


def _nodes(tree: bpy.types.NodeTree, depth: int = 0) -> bytes:
    parts = []
    for node in tree.nodes:
        if node.bl_idname in ("NodeFrame", "NodeReroute"):
            continue
        values = [_value(socket.default_value) for socket in (*node.inputs, *node.outputs) if hasattr(socket, "default_value")]
        parts.append(
            repr((node.name, node.bl_idname, node.mute, values, _name(getattr(node, "image", None)))).encode() + _plain(node, _NODE_LOOKS)
        )
        inner = getattr(node, "node_tree", None)
        if inner is not None and depth < 8:
            parts.append(_nodes(inner, depth + 1))
    parts += [
        repr((link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier, link.is_muted)).encode()
        for link in tree.links
    ]
    return b"|".join(parts)


def _plain(data: bpy.types.bpy_struct, without: frozenset[str] = frozenset()) -> bytes:
    """All numbers, texts and choices of a piece of Blender data, and the names of what it points at."""
    values = []
    for prop in data.bl_rna.properties:
        key = prop.identifier
        if key in _LOOKS or key in without:
            continue
        if prop.type in _PLAIN and not (prop.is_readonly and prop.type == "STRING"):
            values.append((key, _value(getattr(data, key))))
        elif prop.type == "POINTER" and key != "rna_type":
            target = getattr(data, key, None)
            if isinstance(target, bpy.types.ID):
                values.append((key, target.name))
            elif key == "enfilade" and target is not None and isinstance(data, bpy.types.Light):
                values.append((key, _plain(target)))
    return repr(values).encode()


def _value(value):
    """A property as something whose text is the same for the same value."""
    if isinstance(value, (str, bytes, bool, int, float, type(None))):
        return value
    if isinstance(value, bpy.types.ID):
        return value.name
    try:
        return tuple(_value(v) for v in value)
    except TypeError:
        return ""


def _name(data: bpy.types.ID | None) -> str:
    return data.name if data is not None else ""
