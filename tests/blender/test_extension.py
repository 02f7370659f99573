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
# It ends at once: unloading Blender may hang.
RUN = """
import os, sys, traceback

code = 1
try:
    exec(sys.argv[1])
    code = 0
except BaseException:
    traceback.print_exc()
sys.stdout.flush()
sys.stderr.flush()
os._exit(code)
"""
PREPARE = """
import json, sys
import bpy, addon_utils

folder = sys.argv[2]
sys.path.insert(0, sys.argv[3])
from extension_traces import traces, watch
watch()
repository = bpy.context.preferences.extensions.repos.new(
    name="Checkout", module="checkout", custom_directory=folder, remote_url="")
repository.use_custom_directory = True
addon_utils.extensions_refresh(ensure_wheels=True)
MODULE = "bl_ext.checkout.patchnet"

def enable():
    assert addon_utils.enable(MODULE, default_set=True) is not None

def disable():
    addon_utils.disable(MODULE, default_set=True)
"""

SWITCH = """
states = [traces()]
for _ in range(2):
    enable()
    states.append(traces())
    disable()
    states.append(traces())
print(json.dumps(states))
"""

ENABLE = """
enable()
heavy = sorted({"numba", "torch", "safetensors"} & set(sys.modules))

def kernels():
    \"\"\"Whether a render without a window keeps kernels where jobs keep them.\"\"\"
    import importlib
    importlib.import_module(MODULE + ".operators.render_engine.render_frame")
    import numba
    return numba.config.CACHE_DIR.startswith(bpy.utils.extension_path_user(MODULE, path="cache"))

warnings = {name: text for name, text in addon_utils._extensions_warnings_get().items() if "patchnet" in name}
print(json.dumps({
    "warnings": warnings,
    "enabled": MODULE in bpy.context.preferences.addons,
    "heavy": heavy,
    "kernels": kernels(),
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
        [sys.executable, "-c", RUN, PREPARE + code, str(repository), str(ROOT / ".ci")],
        env={name: value for name, value in os.environ.items() if name != "PATCHNET_CACHE"}
        | {"BLENDER_USER_RESOURCES": str(resources)},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr, done.stdout + done.stderr
    return json.loads(done.stdout.strip().splitlines()[-1])


def test_enable_disable_enable(repository: Path) -> None:
    off, on, off_again, on_again, off_at_last = in_fresh_blender(SWITCH, repository)
    assert off == {}
    assert {"classes", "properties", "handlers", "engines", "held"} <= set(on)
    assert off == off_again == off_at_last
    assert on == on_again


def test_enabling_is_light_and_clean(repository: Path) -> None:
    state = in_fresh_blender(ENABLE, repository)
    assert state == {"warnings": {}, "enabled": True, "heavy": [], "kernels": True, "named": []}
