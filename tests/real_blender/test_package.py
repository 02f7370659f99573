# SPDX-License-Identifier: GPL-3.0-or-later
"""The installed zip in a real Blender: enable it, and disable it without leftovers."""

import json
from pathlib import Path

from patchnet.tests.real_blender.executable import ROOT, Blender

MODULE = "bl_ext.user_default.patchnet"
# Factory settings know where extensions lie, but have none enabled: this is the first time in the process.
SCRIPT = f"""
import json, sys, time
sys.path.insert(0, {str(ROOT / ".ci")!r})
import addon_utils
from extension_traces import traces, watch

watch()
addon_utils.extensions_refresh()
states = [traces()]
start = time.process_time()
for _ in range(2):
    addon_utils.enable({MODULE!r}, refresh_handled=True)
    took = time.process_time() - start
    states.append(traces())
    addon_utils.disable({MODULE!r}, refresh_handled=True)
    states.append(traces())
    print("cost:", round(took, 3))
    start = time.process_time()
print("heavy:", json.dumps(sorted({{"numba", "torch", "safetensors"}} & set(sys.modules))))
print("states:", json.dumps(states))
"""


def test_disabling_leaves_nothing(installed: Blender, out: Path) -> None:
    script = out / "switch.py"
    script.write_text(SCRIPT)
    done = installed.run("-b", "--factory-startup", "--python-exit-code", "1", "-P", script)
    assert done.returncode == 0 and "Traceback" not in done.stdout + done.stderr, done.stdout + done.stderr
    said = dict(line.split(": ", 1) for line in done.stdout.splitlines() if line.startswith(("heavy: ", "states: ")))
    assert json.loads(said["heavy"]) == []
    off, on, off_again, on_again, off_at_last = json.loads(said["states"])
    assert off == off_again == off_at_last == {}
    assert on == on_again and {"classes", "properties", "handlers", "engines", "held"} <= set(on)
