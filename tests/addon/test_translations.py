"""Texts in other languages belong to texts in English."""

import pytest


def shown(bpy):
    """All labels, names and items of the add-on by the context under which Blender translates them."""
    texts, groups = set(), []
    for name in dir(bpy.types):
        if name.startswith("ENFILADE_"):
            texts.add(("Operator" if "_OT_" in name else "*", getattr(getattr(bpy.types, name), "bl_label", "")))
    for name in dir(bpy.ops.enfilade):
        groups.append(getattr(bpy.ops.enfilade, name).get_rna_type())
    for owner in (bpy.types.Scene, bpy.types.Object, bpy.types.Collection, bpy.types.WindowManager):
        groups += [p.fixed_type for p in owner.bl_rna.properties if p.identifier.startswith("enfilade") and p.type == "POINTER"]
    while groups:
        for prop in groups.pop().properties:
            texts.add(("*", prop.name))
            if prop.type == "ENUM":
                texts.update(("*", item.name) for item in prop.enum_items)
            if prop.type == "POINTER" and prop.fixed_type.identifier.startswith("ENFILADE_"):
                groups.append(prop.fixed_type)
    from enfilade.addon.preferences import ENFILADE_AP_preferences

    return texts | {("*", prop.name) for prop in ENFILADE_AP_preferences.bl_rna.properties}


def test_every_translation_is_of_something_shown(shop):
    from enfilade.addon.translations import LANGUAGES

    for texts in LANGUAGES.values():
        assert set(texts) - shown(shop.bpy) == set()
        assert all(texts.values())


@pytest.mark.parametrize(("context", "text", "german"), [("Operator", "Find Rooms", "Räume finden"), ("*", "Role", "Rolle")])
def test_blender_finds_them(shop, context, text, german):
    view = shop.bpy.context.preferences.view
    try:
        view.language = "de_DE"
    except TypeError:
        pytest.skip("this Blender has no translations")
    try:
        view.use_translate_interface = True
        if shop.bpy.app.translations.locale not in ("de_DE", "de"):
            pytest.skip("this Blender has no translations")
        assert shop.bpy.app.translations.pgettext_iface(text, context) == german
    finally:
        view.language = "en_US"
