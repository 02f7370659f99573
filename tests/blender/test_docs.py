# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator reference is what the operators are, and every line that it shows runs."""

import re
from pathlib import Path

import bpy
import pytest

from patchnet.docs import make_operators
from patchnet.tests.blender.job_scene import build

pytestmark = pytest.mark.usefixtures("registered")

DOCS = Path(make_operators.__file__).parent
LINES = {name: note.line for name, note in make_operators.NOTES.items() if note.line}
LINK = re.compile(r"\]\((?!https?:)([^)#\s]+)|src=\"([^\"]+)\"")


def test_operators_page_is_what_the_script_makes() -> None:
    assert make_operators.PAGE.read_text(encoding="utf-8") == make_operators.page(), (
        "run python docs/make_operators.py and commit docs/operators.md"
    )


@pytest.mark.parametrize("name", LINES)
def test_lines_of_the_page_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not hasattr(bpy.types, f"PATCHNET_OT_{name}"):
        pytest.skip(f"there is no operator {name}")
    if name == "clear_cache":
        monkeypatch.setenv("PATCHNET_CACHE", str(tmp_path / "cache"))
    build()
    settings = bpy.context.scene.patchnet
    settings.size = (16, 16)
    if name != "refine_with_cycles":
        settings.light = "two-lights"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    for call in LINES[name].split("; "):
        assert eval(call, {"bpy": bpy}) == {"FINISHED"}, call
    for path in re.findall(r"'//([^']+)'", LINES[name]):
        assert (tmp_path / path).exists()


@pytest.mark.parametrize("page", [DOCS.parent / "README.md", *sorted(DOCS.glob("*.md"))], ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for groups in LINK.findall(page.read_text(encoding="utf-8")):
        target = next(text for text in groups if text)
        assert (page.parent / target).exists(), target
