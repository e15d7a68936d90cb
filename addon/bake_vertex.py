# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertex colours: a FLOAT_COLOR attribute that keeps the full range of the light."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import bpy
import numpy as np

from ..core.photometry import recombined
from .mesh_arrays import bulk


def write_colors(mesh: bpy.types.Mesh, name: str, domain: str, color: np.ndarray) -> None:
    """Put colours (C, 4) or (V, 4) into a new attribute of a mesh and make it the active colour; tags it for clearing.

    domain : ``"corner"`` or ``"point"``. The colour that other uses take by default stays what it was.
    """
    default = mesh.attributes.default_color_name
    mesh.enfilade.previous_color = mesh.attributes.active_color_name or ""
    mesh.enfilade.previous_default = default or ""
    made = mesh.color_attributes.new(name=name, type="FLOAT_COLOR", domain=domain.upper())
    mesh.enfilade.attribute = made.name
    # A reference from before another layer was added may be stale: always by name.
    mesh.color_attributes[mesh.enfilade.attribute].data.foreach_set("color", np.ascontiguousarray(color, np.float32).ravel())
    mesh.attributes.active_color_name = mesh.enfilade.attribute
    if default:
        mesh.attributes.default_color_name = default
    mesh.update()


def write_part(mesh: bpy.types.Mesh, group: str, domain: str, color: np.ndarray) -> None:
    """Keep the colours of one light group in an attribute of their own; the active and the default one stay what they are."""
    attributes = mesh.attributes
    active, default = attributes.active_color_name, attributes.default_color_name
    part = mesh.enfilade.parts.add()
    part.name = group
    part.attribute = mesh.color_attributes.new(name=f"{mesh.enfilade.attribute}.{group}", type="FLOAT_COLOR", domain=domain.upper()).name
    mesh.color_attributes[part.attribute].data.foreach_set("color", np.ascontiguousarray(color, np.float32).ravel())
    mesh.attributes.active_color_name, mesh.attributes.default_color_name = active, default


def recombine(mesh: bpy.types.Mesh, factors: Mapping[str, Sequence[float]]) -> None:
    """Add the light groups of a mesh up in its bake; ``factors`` (3,) by their names, 1 for others.

    A mesh that has none, is in edit mode, or has lost one of them or its form, is left as it is.
    """
    tags, colors = mesh.enfilade, mesh.color_attributes
    names = [part.attribute for part in tags.parts]
    if not names or mesh.is_editmode or any(name not in colors for name in (tags.attribute, *names)):
        return
    if any(len(colors[name].data) != len(colors[tags.attribute].data) for name in names):
        return
    parts = (bulk(colors[name].data, "color", np.float32, 4) for name in names)
    color = recombined(tags.quantity, parts, [factors.get(part.name, (1.0, 1.0, 1.0)) for part in tags.parts])
    colors[tags.attribute].data.foreach_set("color", color.ravel())
    mesh.update()


def remove_colors(mesh: bpy.types.Mesh) -> None:
    """Take away what :func:`write_colors` and :func:`write_part` made."""
    tags, attributes = mesh.enfilade, mesh.attributes
    names = [name for name in (tags.attribute, *(part.attribute for part in tags.parts)) if name in mesh.color_attributes]
    if names:
        active, default = attributes.active_color_name in names, attributes.default_color_name in names
        for name in names:
            mesh.color_attributes.remove(mesh.color_attributes[name])
        # Blender keeps the name of an attribute that is gone as that of the active one.
        if active:
            mesh.attributes.active_color_name = tags.previous_color if tags.previous_color in mesh.color_attributes else ""
        if default:
            mesh.attributes.default_color_name = tags.previous_default if tags.previous_default in mesh.color_attributes else ""
        mesh.update()
    tags.parts.clear()
    tags.attribute = tags.previous_color = tags.previous_default = ""
