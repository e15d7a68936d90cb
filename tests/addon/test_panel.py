"""What the panels show: every option, so that nothing can be done from the command line alone."""

import ast
import dataclasses
from pathlib import Path

import pytest
from enfilade.core.options import BakeOptions, Options

PANEL = Path(__file__).resolve().parents[2] / "addon" / "panel.py"


@pytest.mark.parametrize("options", [Options, BakeOptions])
def test_every_option_is_in_a_panel(options):
    shown = {node.value for node in ast.walk(ast.parse(PANEL.read_text(encoding="utf-8"))) if isinstance(node, ast.Constant)}
    names = {field.name for field in dataclasses.fields(options)}
    # Blender's property groups have a name already.
    names = {"bake_name" if name == "name" else name for name in names}
    assert names <= shown
