"""The documentation against what it speaks of."""

import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from enfilade.core.options import BakeOptions, Options, describe
from enfilade.docs import make_options

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "sample_scenes").glob("*.md"))]


def test_options_page_is_current():
    assert make_options.PAGE.read_text(encoding="utf-8") == make_options.page(), "run python -m enfilade.docs.make_options"


def test_options_page_names_every_option():
    page = make_options.page()
    for info in (*describe(Options), *describe(BakeOptions)):
        assert f"| `{info.flag}` |" in page


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if not target.startswith("https://"):
            assert (page.parent / target).exists(), target


def test_readme_opens_with_the_picture_and_names_both_commands():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert re.match(r"!\[[^\]]+\]\(docs/images/apartment\.png\)", text)
    assert "make bake\nmake test\n" in text


def test_the_readmes_python_runs():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    program = re.search(r"```python\n(.*?)```", text, re.DOTALL)[1]
    scene = ROOT / "tests" / "data" / "bench" / "furnace.npz"
    assert '"building.json"' in program
    names: dict = {}
    exec(program.replace('"building.json"', repr(str(scene))), names)
    assert names["light"].shape == (15, 3)


def test_ci_runs_the_readmes_test_command():
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    targets = re.search(r"^for target in ([a-z ]+); do\n  make \"\$target\"", script, re.MULTILINE)[1].split()
    assert targets[-1] == "test"


def test_makefile_pins_a_blender_that_the_manifest_allows():
    pinned = re.search(r"^BPY = ([\d.]+)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)[1]
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert tuple(map(int, pinned.split("."))) >= tuple(map(int, manifest["blender_version_min"].split(".")))


@pytest.mark.parametrize("python", ["", "/no/such/python"])
def test_make_says_in_a_sentence_that_python_is_not_fit(tmp_path, python):
    command = ["make", "-C", str(ROOT), "bake", f"PYTHON={python}", f"VENV={tmp_path / 'venv'}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    sentences = [line for line in done.stderr.splitlines() if line.startswith("enfilade: ")]
    assert len(sentences) == 1
    assert not (tmp_path / "venv").exists()
