# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference pages match operators and commands; documented lines and the tutorial run."""

import ast
import re
from pathlib import Path
from typing import Any

import bpy
import pytest

from patchnet.docs import make_commands, make_operators
from patchnet.operators.overlay.panel import PATCHNET_PT_overlay
from patchnet.tests.blender.drawn import TABS, drawn, settings_drawn
from patchnet.tests.blender.job_scene import build

pytestmark = pytest.mark.usefixtures("registered")

DOCS = Path(make_operators.__file__).parent
LINES = {name: note.line for name, note in make_operators.NOTES.items() if note.line}


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
    settings.size, bpy.context.scene.render.filepath = (16, 16), "//frames/"
    if name != "refine_with_cycles":
        settings.light = "two-lights"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    for call in LINES[name].split("; "):
        assert eval(call, {"bpy": bpy}) == {"FINISHED"}, call
    for path in re.findall(r"'//([^']+)'", LINES[name]):
        assert (tmp_path / path).exists()


def test_commands_page_is_what_the_script_makes() -> None:
    assert make_commands.PAGE.read_text(encoding="utf-8") == make_commands.page(), (
        "run python docs/make_commands.py and commit docs/commands.md"
    )


def settings_of_panels() -> dict[str, set[str]]:
    """Labels of the settings that each panel of the tab draws, whatever other settings are chosen; by its title."""
    known, window = bpy.context.scene.patchnet.bl_rna.properties, bpy.context.window_manager.patchnet_overlay
    bpy.context.scene.patchnet.track = True
    found = {tab.bl_label: {known[name].name for name in settings_drawn(tab) if name in known} for tab in TABS}
    names = set(drawn(PATCHNET_PT_overlay, bl_space_type="VIEW_3D")) & set(window.bl_rna.properties.keys())
    found[PATCHNET_PT_overlay.bl_label] = {window.bl_rna.properties[name].name for name in names}
    return {title: settings for title, settings in found.items() if settings}


def test_panel_page_names_every_setting_of_every_panel() -> None:
    build()
    text = (DOCS / "panel.md").read_text(encoding="utf-8")
    table = text.partition("| where | settings |\n|---|---|\n")[2].partition("\n\n")[0]
    rows = dict(line.strip("| ").split(" | ", 1) for line in table.splitlines())
    named = {where: set(re.findall(r"\*\*(.+?)\*\*", settings)) for where, settings in rows.items()}
    named["PatchNet"] ^= {"Y", "Picture Size Y"}  # beside X, as in the panel
    assert named == settings_of_panels()


def test_command_line_page_names_every_argument_of_run() -> None:
    run = (DOCS / "commands.md").read_text(encoding="utf-8").partition("\n## `run`\n")[2].partition("\n## ")[0]
    named = set(re.findall(r"--[\w-]+", (DOCS / "command-line.md").read_text(encoding="utf-8")))
    arguments = {name for name in re.findall(r"`(--[\w-]+)`", run) if not name.startswith("--cycles-")}
    assert len(arguments) > 30 and arguments - named == set()


def cells(page: Path) -> list[str]:
    """Code of the cells of a page that runs, without their options."""
    found = re.findall(
        r"^```\{code-cell\} python\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    return [re.sub(r"^:.*\n", "", cell, flags=re.MULTILINE) for cell in found]


def run_cell(code: str, names: dict[str, Any]) -> Any:
    """Run a cell as a notebook does; the value of its last line if that is an expression, else None."""
    body = ast.parse(code).body
    last = body.pop() if isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names) if isinstance(last, ast.Expr) else None


def test_page_of_a_scene_runs() -> None:
    code = cells(DOCS / "first-scene.md")
    whole = "\n".join(code)
    small = {
        "patchnet.register()": "pass",  # the fixture did it
        "resolution_y = 300": "resolution_y = 16",
        "(96, 96)": "(16, 16)",
        '"CPU", 16, False': '"CPU", 1, False',
    }
    assert all(whole.count(words) == 1 for words in small)
    for words, others in small.items():
        code = [cell.replace(words, others) for cell in code]
    names: dict[str, Any] = {}
    values = [run_cell(cell, names) for cell in code]
    pictures = [value for value in values if hasattr(value, "_repr_png_")]
    assert len(pictures) == 6 and all(picture._repr_png_().startswith(b"\x89PNG") for picture in pictures)
    rows = names["table"].rows
    assert rows[0].error < names["table"].unrefined
    assert names["result_of"](names["scene"]) is None
