"""What may import what: core stands alone, nothing imports in a circle, and no file is run at import of the root."""

import ast
import graphlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MODULES = {
    ".".join(["enfilade", *path.relative_to(ROOT).with_suffix("").parts]).removesuffix(".__init__"): path
    for top in ("addon", "core")
    for path in sorted((ROOT / top).rglob("*.py"))
}
CORE = [name for name in MODULES if name.startswith("enfilade.core")]


def imports(name: str, everywhere: bool = True) -> set[str]:
    """Modules that a module imports; ``everywhere`` False counts only what runs when it is imported itself."""
    path = MODULES[name]
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inner = {n for f in ast.walk(tree) if isinstance(f, ast.FunctionDef | ast.Lambda) for n in ast.walk(f)}
    found: set[str] = set()
    for node in ast.walk(tree):
        if not everywhere and node in inner:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            whole = ".".join([*base, *([node.module] if node.module else [])])
            found |= {f"{whole}.{alias.name}" if f"{whole}.{alias.name}" in MODULES else whole for alias in node.names}
    return found


def test_core_imports_only_itself_numpy_and_the_standard_library():
    allowed = {"enfilade", "numpy", *sys.stdlib_module_names} - {"pickle", "multiprocessing", "socket", "urllib", "http"}
    wrong = {name: found for name in CORE if (found := {i for i in imports(name) if i.split(".")[0] not in allowed})}
    assert wrong == {"enfilade.core.wire": {"pickle"}}  # between a process and the workers that it started, never from a file


def test_core_knows_nothing_of_the_add_on():
    wrong = {name: found for name in CORE if (found := {i for i in imports(name) if i == "enfilade" or i.startswith("enfilade.addon")})}
    assert wrong == {}


def test_no_import_cycles():
    graph = {name: imports(name, everywhere=False) & set(MODULES) - {name} for name in MODULES}
    try:
        tuple(graphlib.TopologicalSorter(graph).static_order())
    except graphlib.CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_core_never_loads_blender():
    """All of core in a fresh process, which must not have met bpy afterwards."""
    program = f"""
import importlib, importlib.util, sys
spec = importlib.util.spec_from_file_location("enfilade", {str(ROOT / "__init__.py")!r}, submodule_search_locations=[{str(ROOT)!r}])
sys.modules["enfilade"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(sys.modules["enfilade"])
for name in {CORE!r}:
    importlib.import_module(name)
print(sorted(n for n in sys.modules if n.split(".")[0] in ("bpy", "bmesh", "mathutils", "bpy_extras") or n.startswith("enfilade.addon")))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"


def test_core_does_not_print():
    wrong = [
        name
        for name in CORE
        if any(
            isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
            for node in ast.walk(ast.parse(MODULES[name].read_text(encoding="utf-8")))
        )
    ]
    assert wrong == []
