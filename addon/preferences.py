# SPDX-License-Identifier: GPL-3.0-or-later
"""What holds for this machine and not for a file: how many processes work, and where they may keep things."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy

from .. import __package__ as base_package
from ..core.options import Options


class ENFILADE_AP_preferences(bpy.types.AddonPreferences):
    """Threads and the cache folder."""

    bl_idname = base_package

    threads: bpy.props.IntProperty(
        name="Threads",
        description="How many processes a bake may use on this machine, for files that leave the choice open; 0: one for every core",
        default=0,
        min=0,
        max=1024,
    )
    cache_folder: bpy.props.StringProperty(
        name="Cache Folder",
        description="Folder in which a bake keeps what it has finished, so that it can be resumed, and what memory has no room for; "
        "files that name a store of their own keep it. Empty: nothing is kept",
        subtype="DIR_PATH",
    )

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        column = layout.column()
        column.prop(self, "threads")
        column.prop(self, "cache_folder")


def on_this_machine(options: Options) -> Options:
    """The options with what the file leaves open taken from the preferences; as they are where there are no preferences."""
    entry = bpy.context.preferences.addons.get(base_package)
    if entry is None or entry.preferences is None:
        return options
    return with_preferences(options, entry.preferences.threads, entry.preferences.cache_folder, bpy.data.filepath)


def with_preferences(options: Options, threads: int, cache_folder: str, file: str) -> Options:
    """Options with a number of threads and a folder for ``file``, where they name none themselves."""
    if not options.threads and threads:
        options = replace(options, threads=threads)
    if not options.store and cache_folder:
        options = replace(options, store=str(Path(bpy.path.abspath(cache_folder)) / (Path(file).stem or "untitled")))
    return options


def register() -> None:
    bpy.utils.register_class(ENFILADE_AP_preferences)


def unregister() -> None:
    bpy.utils.unregister_class(ENFILADE_AP_preferences)
