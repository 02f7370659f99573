# SPDX-License-Identifier: GPL-3.0-or-later
"""The checkout itself as a live extension: enabled, disabled and enabled again on fresh user resources."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Each test runs in a process of its own: Blender keeps preferences and loaded extensions for the life of a process.
PREPARE = """
import json, sys
import bpy, addon_utils

folder = sys.argv[1]
before = set(dir(bpy.types))
repository = bpy.context.preferences.extensions.repos.new(
    name="Checkout", module="checkout", custom_directory=folder, remote_url="")
repository.use_custom_directory = True
addon_utils.extensions_refresh(ensure_wheels=True)
MODULE = "bl_ext.checkout.patchnet"

def ours():
    return sorted(name for name in set(dir(bpy.types)) - before if "PATCHNET" in name.upper())

def properties():
    return sorted(name for owner in (bpy.types.Scene, bpy.types.Object, bpy.types.WindowManager)
                  for name in dir(owner) if name.startswith("patchnet"))

def enable():
    assert addon_utils.enable(MODULE, default_set=True) is not None

def disable():
    addon_utils.disable(MODULE, default_set=True)
"""

SWITCH = """
states = [[ours(), properties()]]
for _ in range(2):
    enable()
    states.append([ours(), properties()])
    disable()
    states.append([ours(), properties()])
print(json.dumps(states))
"""

ENABLE = """
enable()
warnings = {name: text for name, text in addon_utils._extensions_warnings_get().items() if "patchnet" in name}
print(json.dumps({
    "warnings": warnings,
    "enabled": MODULE in bpy.context.preferences.addons,
    "heavy": sorted({"numba", "torch", "safetensors"} & set(sys.modules)),
    "named": sorted(name for name in sys.modules if name == "patchnet" or name.startswith("patchnet.")),
}))
"""


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """An extension repository that holds a link to this checkout."""
    folder = tmp_path / "repository"
    folder.mkdir()
    (folder / "patchnet").symlink_to(ROOT, target_is_directory=True)
    return folder


def in_fresh_blender(code: str, repository: Path):
    """Run `code` after PREPARE in a new process with empty user resources; what its last line says."""
    resources = repository.parent / "resources"
    resources.mkdir()
    done = subprocess.run(
        [sys.executable, "-c", PREPARE + code, str(repository)],
        env={**os.environ, "BLENDER_USER_RESOURCES": str(resources)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr, done.stdout + done.stderr
    return json.loads(done.stdout.strip().splitlines()[-1])


def test_enable_disable_enable(repository: Path) -> None:
    off, on, off_again, on_again, off_at_last = in_fresh_blender(SWITCH, repository)
    assert off == [[], []]
    assert on[0], "no classes were registered"
    assert off == off_again == off_at_last
    assert on == on_again


def test_enabling_is_light_and_clean(repository: Path) -> None:
    state = in_fresh_blender(ENABLE, repository)
    assert state == {"warnings": {}, "enabled": True, "heavy": [], "named": []}
