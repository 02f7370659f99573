# SPDX-License-Identifier: GPL-3.0-or-later
"""A real Blender with the extension installed from its zip, as a user would have it.

BLENDER=/path/to/blender takes that one; its window opens under xvfb-run where there is no display. Otherwise a small
Debian with Blender 5.2 is made in BLENDER_ROOT (.blender-root), which needs root.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import ROOT, Blender

OUT = ROOT / "out" / "real-blender"
_SCENE = "bl_ext.user_default.patchnet.operators.demo_scene"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Memory comes first: it is measured where no kernel is compiled yet, and the others take those kernels."""
    items.sort(key=lambda item: item.path.name != "test_memory.py")


@pytest.fixture(scope="session")
def out() -> Path:
    """An empty folder for what the tests leave."""
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    return OUT


@pytest.fixture(scope="session")
def blender(out: Path) -> Blender:
    """Blender with user resources of its own, without the extension."""
    # A visit finds no octree of another one; test_reload.py asks for some.
    environment = {"BLENDER_USER_RESOURCES": str(out / "resources"), "PATCHNET_KEEP": "0"}
    (out / "resources").mkdir()
    if named := os.environ.get("BLENDER"):
        return Blender((), named, environment)
    root = Path(os.environ.get("BLENDER_ROOT") or ROOT / ".blender-root").absolute()
    prefix = (str(ROOT / ".ci" / "blender-root"), str(root))
    done = subprocess.run([*prefix, "true"], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.exit(f"no Blender to test with: {done.stderr.strip()}", returncode=2)
    return Blender(prefix, "blender", environment)


@pytest.fixture(scope="session")
def archive(blender: Blender, out: Path) -> Path:
    """The extension's zip for this Blender's Python."""
    python = blender.value("'%d.%d' % sys.version_info[:2]")
    command = [sys.executable, ROOT / ".ci" / "build_extension.py", "--out", out / "zips", "--wheels", python]
    subprocess.run(command, check=True, capture_output=True)
    (found,) = (out / "zips").glob("*-cp*.zip")
    return found


@pytest.fixture(scope="session")
def installed(blender: Blender, archive: Path) -> Blender:
    """Blender with the extension installed and enabled by Blender's own command."""
    done = blender.run("--command", "extension", "install-file", "-r", "user_default", "--enable", archive)
    assert done.returncode == 0, done.stdout + done.stderr
    return blender


@pytest.fixture(scope="session")
def courtyard(installed: Blender, out: Path) -> Path:
    """The demo scene, built by the installed extension."""
    path = out / "courtyard.blend"
    save = f"from {_SCENE} import save_demo_scene; save_demo_scene(Path({str(path)!r}))"
    installed.execute(f"from pathlib import Path; {save}")
    return path


@pytest.fixture(scope="session")
def visit(installed: Blender, courtyard: Path, out: Path) -> dict:
    """Report of window.py."""
    script = Path(__file__).with_name("window.py")
    done = installed.run_window(courtyard, "-P", script, "--", out)
    (out / "window.log").write_text(done.stdout + done.stderr)
    report = out / "window.json"
    assert report.exists(), f"Blender ended with code {done.returncode} before the visit did: see {out / 'window.log'}"
    seen: dict = json.loads(report.read_text())
    return seen | {"said": done.stdout + done.stderr}
