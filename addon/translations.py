# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panels say in other languages. Texts that are not here are shown in English, or as Blender itself translates them."""

from __future__ import annotations

import bpy

from .. import __package__ as base_package

ANY, OPERATOR = "*", "Operator"
"""Contexts of Blender's translations: that of names and descriptions, and that of the labels of buttons."""

GERMAN = {
    (OPERATOR, "Bake"): "Backen",
    (OPERATOR, "Cancel"): "Abbrechen",
    (OPERATOR, "Clear Bake"): "Licht entfernen",
    (OPERATOR, "Show Bake"): "Licht zeigen",
    (OPERATOR, "Check"): "Prüfen",
    (OPERATOR, "Find Rooms"): "Räume finden",
    (OPERATOR, "Mark as Room"): "Als Raum kennzeichnen",
    (OPERATOR, "Portal from Faces"): "Portal aus Flächen",
    (OPERATOR, "Portal from Objects"): "Portal aus Objekten",
    (OPERATOR, "Show Clusters"): "Cluster zeigen",
    (OPERATOR, "Find Leaks"): "Undichte Stellen suchen",
    (ANY, "Rooms and Portals"): "Räume und Portale",
    (ANY, "Check"): "Prüfung",
    (ANY, "Rooms"): "Räume",
    (ANY, "Portals"): "Portale",
    (ANY, "Role"): "Rolle",
    (ANY, "Room"): "Raum",
    (ANY, "Ignored"): "Nicht beachtet",
    (ANY, "By Name"): "Nach dem Namen",
    (ANY, "Left Out"): "Ausgelassen",
    (ANY, "Rooms by Hand"): "Räume von Hand",
    (ANY, "Glass"): "Glas",
    (ANY, "Texel Scale"): "Texeldichte (Faktor)",
    (OPERATOR, "Light Report"): "Lichtbericht",
    (ANY, "Light Report"): "Lichtbericht",
    (ANY, "Daylight Factor"): "Tageslichtquotient",
    (ANY, "Illuminance"): "Beleuchtungsstärke",
    (ANY, "Behind"): "Dahinter",
    (ANY, "In Front"): "Davor",
    (ANY, "Cut Objects Apart"): "Objekte zerteilen",
    (ANY, "Remove Faces"): "Flächen entfernen",
    (ANY, "Leave Objects Out"): "Objekte auslassen",
    (ANY, "Fit to Opening"): "An die Öffnung anpassen",
    (ANY, "Cache Folder"): "Ordner für Zwischenstände",
    (ANY, "Quality"): "Qualität",
    (ANY, "Draft"): "Entwurf",
    (ANY, "Good"): "Gut",
    (ANY, "Fine"): "Fein",
    (ANY, "Reflected Light"): "Reflektiertes Licht",
    (ANY, "Light Groups"): "Lichtgruppen",
    (ANY, "Bake Presets"): "Vorgaben",
}

LANGUAGES = {"de_DE": GERMAN, "de": GERMAN}
"""By Blender's names of languages, old and new."""


def register() -> None:
    bpy.app.translations.register(base_package, LANGUAGES)


def unregister() -> None:
    bpy.app.translations.unregister(base_package)
