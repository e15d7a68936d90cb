# SPDX-License-Identifier: GPL-3.0-or-later
"""What is saved in the .blend file: the choices of the user, made from the options dataclasses, and the tags of a bake."""

from __future__ import annotations

from typing import Any, TypeVar

import bpy

from ..core.options import BakeOptions, OptionInfo, Options, describe
from .recombine import recombine

_Options = TypeVar("_Options", Options, BakeOptions)

_MEGABYTE = 2**20
_ABBREVIATIONS = {"exr": "OpenEXR", "png": "PNG"}
_LABELS = {
    "order": "Basis Order",
    "average": "Cluster Size",
    "emitters": "Shoot From",
    "volumes": "Seen Through",
    "reflected": "Reflected Light",
    "min_element_size": "Element Size",
    "max_resolution": "Resolution",
    "name": "Bake Name",
    "groups": "Light Groups",
}
"""Names of options in the panels, where their own would be unclear or too long for a narrow panel."""


def label(info: OptionInfo) -> str:
    """The name of an option as Blender writes names."""
    text = _LABELS.get(info.name) or info.name.replace("_", " ").title()
    return f"{text} (MB)" if info.kind == "size" else text


def _property(info: OptionInfo) -> Any:
    unit = f" ({info.unit})" if info.unit and info.kind != "size" else ""
    shared = {"name": label(info), "description": info.help.rstrip(".") + unit}
    if info.kind == "choice":
        items = [(c, _ABBREVIATIONS.get(c, c.replace("_", " ").title()), "") for c in info.choices]
        return bpy.props.EnumProperty(items=items, default=info.default, **shared)
    if info.kind == "bool":
        return bpy.props.BoolProperty(default=info.default, **shared)
    if info.kind == "size":
        return bpy.props.IntProperty(default=info.default // _MEGABYTE, min=0, **shared)
    if info.kind in ("path", "name"):
        subtype = {"subtype": "DIR_PATH"} if info.kind == "path" else {}
        return bpy.props.StringProperty(default=info.default, maxlen=0 if info.kind == "path" else 48, **subtype, **shared)
    limits = {k: v for k, v in (("min", info.minimum), ("max", info.maximum)) if v is not None}
    if info.kind == "int":
        return bpy.props.IntProperty(default=info.default, **{k: int(v) for k, v in limits.items()}, **shared)
    distance = {"subtype": "DISTANCE"} if info.unit == "m" else {}
    return bpy.props.FloatProperty(default=info.default, **limits, **distance, **shared)


def _group(name: str, cls: type, doc: str) -> type:
    annotations = {info.name: _property(info) for info in describe(cls)}
    # Blender keeps the key "name" of a property group for its own use in lists; the option goes by another one.
    annotations = {_key(option): value for option, value in annotations.items()}
    return type(name, (bpy.types.PropertyGroup,), {"__annotations__": annotations, "__doc__": doc})


def _key(option: str) -> str:
    return "bake_name" if option == "name" else option


ENFILADE_PG_solve = _group("ENFILADE_PG_solve", Options, "How the scene is solved.")
ENFILADE_PG_bake = _group("ENFILADE_PG_bake", BakeOptions, "Where the light goes.")


def read_options(group: bpy.types.PropertyGroup, cls: type[_Options], metres_per_unit: float = 1.0) -> _Options:
    """The options that a property group holds; lengths are kept in Blender's unit and come out in metres.

    Raises :class:`~enfilade.core.options.OptionError` when a value is out of its range.
    """
    values = {}
    for info in describe(cls):
        value = getattr(group, _key(info.name))
        if info.kind == "size":
            value *= _MEGABYTE
        elif info.kind == "path":
            value = bpy.path.abspath(value) if value else ""
        elif info.kind == "float":
            # Properties are of single precision: 0.1 must not come back as 0.10000000149.
            value = float(f"{value * (metres_per_unit if info.unit == 'm' else 1.0):.7g}")
        values[info.name] = value
    return cls(**values)


def write_options(group: bpy.types.PropertyGroup, options: Options | BakeOptions, metres_per_unit: float = 1.0) -> None:
    """Store options in a property group, the opposite of :func:`read_options`; sizes are rounded to megabytes."""
    for info in describe(type(options)):
        value = getattr(options, info.name)
        if info.kind == "size":
            value = round(value / _MEGABYTE)
        elif info.kind == "float" and info.unit == "m":
            value /= metres_per_unit
        setattr(group, _key(info.name), value)


def _changed(group: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    recombine(group.id_data)


class ENFILADE_PG_light_group(bpy.types.PropertyGroup):
    """A light group of a bake: how strong it is by now, and in which colour."""

    strength: bpy.props.FloatProperty(
        name="Strength",
        description="How strong the light of this group is: 1 as it was baked, 0 off. The bake is added up anew at once",
        default=1.0,
        min=0.0,
        soft_max=2.0,
        subtype="FACTOR",
        options=set(),
        update=_changed,
    )
    color: bpy.props.FloatVectorProperty(
        name="Color",
        description="The colour that the light of this group is multiplied with: white as it was baked",
        default=(1.0, 1.0, 1.0),
        min=0.0,
        soft_max=1.0,
        subtype="COLOR",
        options=set(),
        update=_changed,
    )


class ENFILADE_PG_part(bpy.types.PropertyGroup):
    """What a bake keeps of one light group, under the name of the group."""

    attribute: bpy.props.StringProperty(options={"HIDDEN"}, description="Name of the colour attribute, on a mesh")
    image: bpy.props.PointerProperty(type=bpy.types.Image, options={"HIDDEN"}, description="The lightmap, on an image")


class ENFILADE_PG_scene(bpy.types.PropertyGroup):
    """All settings of a scene."""

    rooms: bpy.props.PointerProperty(
        type=bpy.types.Collection,
        name="Rooms",
        description="Every child of this collection is a room; empty: the collection named Rooms where there is one, "
        "else the whole scene is one room",
    )
    portals: bpy.props.PointerProperty(
        type=bpy.types.Collection,
        name="Portals",
        description="Every mesh face in this collection is an opening between two rooms or to the outside; empty: the "
        "collection named Portals where there is one",
    )
    solve: bpy.props.PointerProperty(type=ENFILADE_PG_solve)
    bake: bpy.props.PointerProperty(type=ENFILADE_PG_bake)
    groups: bpy.props.CollectionProperty(type=ENFILADE_PG_light_group, name="Light Groups")
    summary: bpy.props.StringProperty(name="Last Bake", options={"HIDDEN"})
    baked_from: bpy.props.StringProperty(options={"HIDDEN"}, description="Fingerprint of the scene and the options of the last bake")


class ENFILADE_PG_object(bpy.types.PropertyGroup):
    """The rooms of a portal where they are set by hand, and what a bake did to an object."""

    by_hand: bpy.props.BoolProperty(name="Rooms by Hand", description="Set the rooms of this portal here, not by where it stands")
    behind: bpy.props.PointerProperty(
        type=bpy.types.Collection, name="Behind", description="The room that the back of the portal's faces looks into; empty: the outside"
    )
    in_front: bpy.props.PointerProperty(
        type=bpy.types.Collection, name="In Front", description="The room that the portal's faces look into; empty: the outside"
    )
    left_out: bpy.props.BoolProperty(
        name="Left Out", description="This object takes no part in the bake: light passes it as if it were not there", default=False
    )
    transmittance: bpy.props.FloatProperty(
        name="Glass",
        description="Part of the light that this portal lets through: 1 for an opening, about 0.8 for a double-glazed window",
        default=1.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    texel_scale: bpy.props.FloatProperty(
        name="Texel Scale",
        description="Texels per metre of this object in textures, as a multiple of Texel Density: more where one comes close, "
        "less where nobody does",
        default=1.0,
        min=0.01,
        max=100.0,
        soft_min=0.125,
        soft_max=8.0,
    )
    carries: bpy.props.PointerProperty(
        type=bpy.types.Object, options={"HIDDEN"}, description="The object that this subdivided copy stands for"
    )
    hidden: bpy.props.BoolProperty(options={"HIDDEN"}, description="Hidden by a bake because a subdivided copy carries the light")
    was_shown: bpy.props.BoolProperty(options={"HIDDEN"}, description="Shown in viewports before a bake hid it")
    own_mesh_of: bpy.props.PointerProperty(type=bpy.types.Mesh, options={"HIDDEN"}, description="The shared mesh that this object had")


class ENFILADE_PG_mesh(bpy.types.PropertyGroup):
    """What a bake made on a mesh."""

    attribute: bpy.props.StringProperty(options={"HIDDEN"}, description="Name of the colour attribute")
    previous_color: bpy.props.StringProperty(options={"HIDDEN"}, description="The active colour attribute before")
    previous_default: bpy.props.StringProperty(options={"HIDDEN"}, description="The default colour attribute before")
    uv_map: bpy.props.StringProperty(options={"HIDDEN"}, description="Name of the lightmap UV map")
    image: bpy.props.PointerProperty(type=bpy.types.Image, options={"HIDDEN"}, description="The lightmap that the UV map is made for")
    quantity: bpy.props.StringProperty(options={"HIDDEN"}, description="What the bake holds: radiosity, lighting or lux")
    parts: bpy.props.CollectionProperty(type=ENFILADE_PG_part, options={"HIDDEN"}, description="The light groups of the attribute")
    made: bpy.props.BoolProperty(options={"HIDDEN"}, description="This mesh is a copy that a bake made")


class ENFILADE_PG_image(bpy.types.PropertyGroup):
    """Marks the images of a bake."""

    made: bpy.props.BoolProperty(options={"HIDDEN"})
    quantity: bpy.props.StringProperty(options={"HIDDEN"}, description="What the image holds: radiosity, lighting or lux")
    parts: bpy.props.CollectionProperty(type=ENFILADE_PG_part, options={"HIDDEN"}, description="The light groups of the image")


class ENFILADE_PG_material(bpy.types.PropertyGroup):
    """Marks the materials that show a bake."""

    made: bpy.props.BoolProperty(options={"HIDDEN"})
    stands_for: bpy.props.PointerProperty(type=bpy.types.Material, options={"HIDDEN"}, description="The material that the slot had")
    new_slot: bpy.props.BoolProperty(options={"HIDDEN"}, description="The object had no slot at all")


_CLASSES = (
    ENFILADE_PG_solve,
    ENFILADE_PG_bake,
    ENFILADE_PG_light_group,
    ENFILADE_PG_part,
    ENFILADE_PG_scene,
    ENFILADE_PG_object,
    ENFILADE_PG_mesh,
    ENFILADE_PG_image,
    ENFILADE_PG_material,
)
_OWNERS = (
    (bpy.types.Scene, ENFILADE_PG_scene),
    (bpy.types.Object, ENFILADE_PG_object),
    (bpy.types.Mesh, ENFILADE_PG_mesh),
    (bpy.types.Image, ENFILADE_PG_image),
    (bpy.types.Material, ENFILADE_PG_material),
)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    for owner, cls in _OWNERS:
        owner.enfilade = bpy.props.PointerProperty(type=cls)


def unregister() -> None:
    for owner, _ in _OWNERS:
        del owner.enfilade
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
