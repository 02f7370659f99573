# SPDX-License-Identifier: GPL-3.0-or-later
"""Every panel in a real window: drawn without errors, and undo and redo with keys."""

import json
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender

PANELS = ("main", "octree", "light", "network", "preview", "compare", "export", "statistics")


@pytest.fixture(scope="module")
def panels(installed: Blender, courtyard: Path, out: Path) -> dict:
    """Report of panels.py."""
    done = installed.run_window(courtyard, "-P", Path(__file__).with_name("panels.py"), "--", out, seconds=400.0)
    (out / "panels.log").write_text(done.stdout + done.stderr)
    report = out / "panels.json"
    assert report.exists(), f"Blender ended with code {done.returncode}: see {out / 'panels.log'}"
    return json.loads(report.read_text()) | {"said": done.stdout + done.stderr}


def test_visit_came_to_its_end(panels: dict) -> None:
    assert panels["problem"] == ""
    assert "Traceback" not in panels["said"]


def test_all_panels_are_drawn(panels: dict, out: Path) -> None:
    assert {f"PATCHNET_PT_{name}" for name in PANELS} <= set(panels["drawn"])
    for name in (*PANELS, "empty", "stale", "preferences"):
        assert (out / f"panel-{name}.png").stat().st_size > 3000


def test_undo_and_redo(panels: dict) -> None:
    assert panels["states"] == [[], ["surface"], [], ["surface"]]
    assert panels["why"].endswith("moved")
