# SPDX-License-Identifier: GPL-3.0-or-later
"""The checkout as an enabled extension on fresh user resources.

What disabling leaves is looked for in zips: by .ci/enable_extension.py, and by tests/real_blender/test_package.py.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

# In a process of its own: Blender keeps preferences and loaded extensions for the life of a process. It ends at once:
# unloading Blender may hang.
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
ENABLE = """
import json, sys
import bpy, addon_utils

folder = sys.argv[2]
repository = bpy.context.preferences.extensions.repos.new(
    name="Checkout", module="checkout", custom_directory=folder, remote_url="")
repository.use_custom_directory = True
addon_utils.extensions_refresh(ensure_wheels=True)
MODULE = "bl_ext.checkout.patchnet"
assert addon_utils.enable(MODULE, default_set=True) is not None
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


def test_enabling_is_light_and_clean(tmp_path: Path) -> None:
    """In an extension repository that holds a link to this checkout."""
    repository, resources = tmp_path / "repository", tmp_path / "resources"
    for folder in (repository, resources):
        folder.mkdir()
    (repository / "patchnet").symlink_to(ROOT, target_is_directory=True)
    done = subprocess.run(
        [sys.executable, "-c", RUN, ENABLE, str(repository)],
        env={name: value for name, value in os.environ.items() if name != "PATCHNET_CACHE"}
        | {"BLENDER_USER_RESOURCES": str(resources)},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr, done.stdout + done.stderr
    state = json.loads(done.stdout.strip().splitlines()[-1])
    assert state == {"warnings": {}, "enabled": True, "heavy": [], "kernels": True, "named": []}
