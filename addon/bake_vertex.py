# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertex colours: a FLOAT_COLOR attribute that keeps the full range of the light."""

from __future__ import annotations

import bpy
import numpy as np


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


def remove_colors(mesh: bpy.types.Mesh) -> None:
    """Take away what :func:`write_colors` made."""
    tags = mesh.enfilade
    name = tags.attribute
    made = mesh.color_attributes.get(name) if name else None
    if made is not None:
        attributes = mesh.attributes
        active, default = attributes.active_color_name == name, attributes.default_color_name == name
        mesh.color_attributes.remove(made)
        # Blender keeps the name of an attribute that is gone as that of the active one.
        if active:
            mesh.attributes.active_color_name = tags.previous_color if tags.previous_color in mesh.color_attributes else ""
        if default:
            mesh.attributes.default_color_name = tags.previous_default if tags.previous_default in mesh.color_attributes else ""
        mesh.update()
    tags.attribute = tags.previous_color = tags.previous_default = ""
