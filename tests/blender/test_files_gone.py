# SPDX-License-Identifier: GPL-3.0-or-later
"""Missing libraries, which another Blender removed, are one sentence in any step."""

import subprocess
import sys

RUN = """
import sys

class Gone:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == sys.argv[1]:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

import bpy
from patchnet.operators import registration
registration.register()
sys.meta_path.insert(0, Gone())
bpy.ops.mesh.primitive_cube_add()
try:
    bpy.ops.patchnet.run_all(resolution="DEPTH", depth=4, light="two-lights")
except RuntimeError as error:
    print("said:", str(error).strip())
"""


def test_missing_libraries_are_one_sentence() -> None:
    done = subprocess.run([sys.executable, "-c", RUN, "llvmlite"], capture_output=True, text=True, check=False)
    assert "said: Error: PatchNet's libraries are gone, as when another Blender removed them" in done.stdout
    assert "Traceback" not in done.stdout + done.stderr
