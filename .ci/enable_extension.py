# SPDX-License-Identifier: GPL-3.0-or-later
"""Install a built zip into the Blender of this Python as a user does, and check that it works.

    python .ci/enable_extension.py dist/patchnet-1.0.0-linux_x64-cp311.zip

Each step is a separate process with separate user resources. It can import Blender, NumPy and Blender's other modules,
but not the pip-installed numba, safetensors, torch and patchnet: the zip must contain them or not need them. Prints one
line per step, and `N passed, N failed` at the end.
"""

import importlib
import os
import statistics
import subprocess
import sys
import sysconfig
import tempfile
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NoReturn

HIDDEN = ("numba", "llvmlite", "safetensors", "torch", "torchgen", "functorch", "PIL", "matplotlib", "scipy")
MODULE = "bl_ext.user_default.patchnet"
ENABLING_S = 0.2  # processor time, which other programs' load does not affect
ENABLED_TIMES = 5


def only_what_blender_has(folder: Path) -> Path:
    """Links in `folder` to all site-packages except HIDDEN: a module path like Blender's own."""
    folder.mkdir()
    for entry in Path(sysconfig.get_path("purelib")).iterdir():
        if entry.name.startswith(("_", "patchnet")) or entry.name.partition("-")[0].partition(".")[0] in HIDDEN:
            continue
        (folder / entry.name).symlink_to(entry)
    return folder


def expect(condition: bool, sentence: str) -> None:
    """End the step unless `condition` holds."""
    if not condition:
        sys.exit(f"failed: {sentence}")


def expect_enabled() -> None:
    """Check that the extension is enabled and has operators, and that Blender has no warnings about it."""
    import addon_utils
    import bpy

    expect(MODULE in bpy.context.preferences.addons, "the extension is in the preferences")
    expect(any(name.startswith("PATCHNET_OT_") for name in dir(bpy.types)), "its operators are registered")
    warnings = {name: text for name, text in addon_utils._extensions_warnings_get().items() if "patchnet" in name}
    expect(not warnings, f"Blender has no warnings about it, but {warnings}")


def install(archive: str) -> None:
    """Install from disk and enable, as in the preferences."""
    import bpy

    bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True)
    expect_enabled()
    heavy = {"numba", "torch", "safetensors"} & set(sys.modules)
    expect(not heavy, f"enabling imports nothing heavy, but {heavy}")
    bpy.ops.wm.save_userpref()


def start_again(archive: str) -> None:
    """Check that a new Blender has it enabled, that bundled modules are the extension's, and so are cached kernels."""
    import bpy

    bpy.ops.wm.read_userpref()
    expect_enabled()
    for name in ("operators.render_engine.render_frame", "patchnet_addon.tracing.render"):  # as a render does
        importlib.import_module(f"{MODULE}.{name}")
    import numba

    expect(bpy.utils.user_resource("EXTENSIONS") in str(numba.__file__), f"{numba.__file__} is the bundled one")
    folder, own = numba.config.CACHE_DIR, bpy.utils.extension_path_user(MODULE, path="cache")
    expect(folder.startswith(own), f"kernels are cached in {folder}, not in {own}")
    print(f"numba {numba.__version__}")


def cost(archive: str) -> None:
    """Measure enabling at Blender's start: import of the add-on and its registration."""
    import addon_utils

    addon_utils.extensions_refresh()
    start = time.process_time()
    addon_utils.enable(MODULE, default_set=True, refresh_handled=True)
    print(f"cost: {time.process_time() - start:.3f}")
    expect_enabled()


def use(archive: str) -> None:
    """Check the files of a whole job on a small scene, with Cycles light and the shipped weights."""
    import bpy

    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.read_userpref()
    bpy.ops.mesh.primitive_monkey_add()
    bpy.ops.object.light_add(type="SUN")
    with tempfile.TemporaryDirectory() as out:
        result = bpy.ops.patchnet.run_all(
            depth=6, light="cycles", max_samples=2, cameras="auto", size=(32, 32), strategy="patchnet", out=out
        )
        expect(result == {"FINISHED"}, f"patchnet.run_all finishes, but {result}")
        written = {path.name for path in Path(out).rglob("*") if path.is_file()}
        missing = {"octree.safetensors", "codes.safetensors", "report.json", "heatmap.png", "priority.exr"} - written
        expect(not missing, f"all files are written, but not {missing}")


STEPS: tuple[Callable[[str], None], ...] = (install, start_again, cost, use)


def run_step(step: Callable[[str], None], archive: Path, environment: dict[str, str]) -> tuple[bool, str]:
    """Run one step in a new process; returns whether it succeeded, and its output."""
    command = [sys.executable, "-S", __file__, "--step", step.__name__, str(archive)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    # Blender only prints errors of register() and unregister().
    good = done.returncode == 0 and "Traceback" not in said
    if not good:
        print(said, flush=True)
    return good, said


def run_cost(archive: Path, environment: dict[str, str]) -> tuple[bool, str]:
    """Enable the extension in several new processes; returns whether the median is in the budget, and a sentence."""
    runs = [run_step(cost, archive, environment) for _ in range(ENABLED_TIMES)]
    took = [float(line.removeprefix("cost: ")) for _, said in runs for line in said.splitlines() if "cost: " in line]
    if not all(good for good, _ in runs) or len(took) < ENABLED_TIMES:
        return False, "the extension was not enabled in every process"
    middle = statistics.median(took)
    return middle < ENABLING_S, f"median {middle:.3f} s of processor time, budget {ENABLING_S} s"


def main() -> int:
    """Run all steps on the zip of the command line; returns 1 if a step failed."""
    archive = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as temporary:
        modules = only_what_blender_has(Path(temporary) / "modules")
        resources = Path(temporary) / "resources"
        resources.mkdir()
        environment = {**os.environ, "PYTHONPATH": str(modules), "BLENDER_USER_RESOURCES": str(resources)}
        # Blender stores compiled modules beside the sources; without them, each start compiles them again and dominates
        # the cost of enabling.
        for name in ("PYTHONDONTWRITEBYTECODE", "PATCHNET_CACHE"):
            environment.pop(name, None)
        passed = 0
        for step in STEPS:
            good, said = (run_cost if step is cost else partial(run_step, step))(archive, environment)
            note = f" ({said})" if step is cost else ""
            print(f"{archive.name}: {step.__name__}: {'passed' if good else 'FAILED'}{note}", flush=True)
            passed += good
    print(f"{passed} passed, {len(STEPS) - passed} failed")
    return int(passed < len(STEPS))


def be_step(name: str, archive: str) -> NoReturn:
    """Run a step and end the process at once: unloading Blender may hang."""
    import bpy  # noqa: F401  makes Blender's own modules importable

    code = 1
    try:
        next(step for step in STEPS if step.__name__ == name)(archive)
        code = 0
    except SystemExit as stop:
        print(stop)
    except Exception:  # noqa: BLE001  any error is printed
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    if sys.argv[1] == "--step":
        be_step(*sys.argv[2:])
    sys.exit(main())
