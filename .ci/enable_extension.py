# SPDX-License-Identifier: GPL-3.0-or-later
"""Install a built zip into the Blender of this Python as a user would, and see that it works.

    python .ci/enable_extension.py dist/patchnet-0.1.0-linux_x64-cp311.zip

Every step is a process of its own on user resources of its own. The steps see Blender, NumPy and what Blender brings
along, but not the pip-installed numba, safetensors, torch and patchnet: those must come out of the zip, or not be
needed. Prints one line a check, and `N passed, N failed` at the end.
"""

import os
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable
from pathlib import Path

HIDDEN = ("numba", "llvmlite", "safetensors", "torch", "torchgen", "functorch", "tqdm", "PIL", "matplotlib", "scipy")
MODULE = "bl_ext.user_default.patchnet"


def only_what_blender_has(folder: Path) -> Path:
    """Links in `folder` to all site-packages except the hidden ones: a module path like that of Blender itself."""
    folder.mkdir()
    for entry in Path(sysconfig.get_path("purelib")).iterdir():
        if entry.name.startswith(("_", "patchnet")) or entry.name.partition("-")[0].partition(".")[0] in HIDDEN:
            continue
        (folder / entry.name).symlink_to(entry)
    return folder


def patchnet_operators() -> list[str]:
    """Names of our operators that Blender knows at the moment."""
    import bpy

    return sorted(name for name in dir(bpy.types) if name.startswith("PATCHNET_OT_"))


def expect(condition: bool, sentence: str) -> None:
    """End the step unless `condition` holds."""
    if not condition:
        sys.exit(f"failed: {sentence}")


def expect_enabled() -> None:
    """The extension is on, has operators, and Blender has nothing to complain about."""
    import addon_utils
    import bpy

    expect(MODULE in bpy.context.preferences.addons, "the extension is in the preferences")
    expect(bool(patchnet_operators()), "its operators are registered")
    warnings = {name: text for name, text in addon_utils._extensions_warnings_get().items() if "patchnet" in name}
    expect(not warnings, f"Blender has no warnings about it, but {warnings}")


def install(archive: str) -> None:
    """Install from disk and enable, as the preferences do."""
    import bpy

    bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True)
    expect_enabled()
    heavy = {"numba", "torch"} & set(sys.modules)
    expect(not heavy, f"enabling imports nothing heavy, but {heavy}")
    bpy.ops.wm.save_userpref()


def start_again(archive: str) -> None:
    """A later start of Blender has it enabled; the bundled modules come from the extension."""
    import bpy

    bpy.ops.wm.read_userpref()
    expect_enabled()
    import numba
    import safetensors

    for module in (numba, safetensors):
        expect(bpy.utils.user_resource("EXTENSIONS") in str(module.__file__), f"{module.__file__} is the bundled one")
    print(f"numba {numba.__version__}, safetensors {safetensors.__version__}")


def switch(archive: str) -> None:
    """Disable and enable leave no trace and lose nothing."""
    import addon_utils
    import bpy

    bpy.ops.wm.read_userpref()
    before = patchnet_operators()
    for _ in range(2):
        addon_utils.disable(MODULE, default_set=True)
        expect(patchnet_operators() == [], f"disabling removes all operators, but {patchnet_operators()} are left")
        addon_utils.enable(MODULE, default_set=True)
        expect(patchnet_operators() == before, "enabling brings all operators back")
    expect_enabled()


def use(archive: str) -> None:
    """The whole job on a small scene, with Cycles light and the shipped weights, writes its files."""
    import bpy

    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.read_userpref()
    bpy.ops.mesh.primitive_monkey_add()
    bpy.ops.object.light_add(type="SUN")
    with tempfile.TemporaryDirectory() as out:
        result = bpy.ops.patchnet.run_all(
            depth=6, light="cycles", samples=1, cameras="auto", size=(32, 32), strategy="patchnet", out=out
        )
        expect(result == {"FINISHED"}, f"patchnet.run_all finishes, but {result}")
        written = {path.name for path in Path(out).rglob("*") if path.is_file()}
        missing = {"octree.safetensors", "codes.safetensors", "report.json", "heatmap.png", "priority.exr"} - written
        expect(not missing, f"all files are written, but not {missing}")


STEPS: tuple[Callable[[str], None], ...] = (install, start_again, switch, use)


def run_step(step: Callable[[str], None], archive: Path, environment: dict[str, str]) -> bool:
    """Run one step in a fresh process; whether it succeeded."""
    command = [sys.executable, "-S", __file__, "--step", step.__name__, str(archive)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    # Blender prints what fails in register() and unregister(), and goes on.
    good = done.returncode == 0 and "Traceback" not in said
    print(f"{archive.name}: {step.__name__}: {'passed' if good else f'FAILED, code {done.returncode}'}", flush=True)
    if not good:
        print(said, flush=True)
    return good


def main() -> int:
    """Run all steps on the zip named on the command line; 1 if one of them failed."""
    archive = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as temporary:
        modules = only_what_blender_has(Path(temporary) / "modules")
        resources = Path(temporary) / "resources"
        resources.mkdir()
        environment = {**os.environ, "PYTHONPATH": str(modules), "BLENDER_USER_RESOURCES": str(resources)}
        passed = sum([run_step(step, archive, environment) for step in STEPS])
    print(f"{passed} passed, {len(STEPS) - passed} failed")
    return int(passed < len(STEPS))


if __name__ == "__main__":
    if sys.argv[1] == "--step":
        import bpy  # noqa: F401  makes Blender's own modules importable

        next(step for step in STEPS if step.__name__ == sys.argv[2])(sys.argv[3])
    else:
        sys.exit(main())
