# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the Blender extension: a plain zip, or one for each Python with the wheels that Blender does not have.

    python .ci/build_extension.py --out dist                           patchnet-0.1.0.zip, without wheels
    python .ci/build_extension.py --out dist --wheels 3.11 3.13        zips for Blender 4.5 and 5.2 on this platform
    python .ci/build_extension.py --out dist --wheels 3.13 --platform windows-x64

Blender's own validator and builder, from the installed `bpy`, do the work. A zip holds the wheels of one platform and
one Python, because llvmlite alone is 57 MiB. NumPy is never bundled: Blender brings its own.
"""

import argparse
import importlib.util
import platform
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BUNDLED = ("numba", "llvmlite", "safetensors")
PLATFORM_TAGS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_12_0_arm64", "macosx_11_0_arm64"),
}


def run(*command: str | Path) -> None:
    """Run a command; its failure ends this one."""
    done = subprocess.run([str(word) for word in command], check=False)
    if done.returncode:
        sys.exit(f"build_extension: {Path(command[1]).name} ended with code {done.returncode}")


def blender_tool() -> Path:
    """Blender's extension tool inside the installed `bpy` package, found without importing it."""
    spec = importlib.util.find_spec("bpy")
    if spec is None or spec.origin is None:
        sys.exit("build_extension: bpy is not installed here; run `make zip`, which sees to it")
    (tool,) = Path(spec.origin).parent.glob("*.*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    return tool


def this_platform() -> str:
    """Blender's name of the platform this runs on."""
    names = {("Linux", "x86_64"): "linux-x64", ("Windows", "AMD64"): "windows-x64", ("Darwin", "arm64"): "macos-arm64"}
    found = names.get((platform.system(), platform.machine()))
    if found is None:
        sys.exit(f"build_extension: no wheels for {platform.system()} {platform.machine()}; build without --wheels")
    return found


def build(source: Path, out: Path) -> Path:
    """Validate the extension in `source`, build the zip file `out`, validate that too."""
    tool = blender_tool()
    run(sys.executable, tool, "validate", source)
    run(sys.executable, tool, "build", "--source-dir", source, "--output-filepath", out)
    run(sys.executable, tool, "validate", out)
    return out


def download_wheels(folder: Path, python: str, target: str) -> list[str]:
    """Fetch the bundled wheels for a Python and a platform; their names, sorted."""
    tags = [word for tag in PLATFORM_TAGS[target] for word in ("--platform", tag)]
    wanted = ("--no-deps", "--only-binary=:all:", "--implementation", "cp", "--python-version", python, *tags)
    where = ("--constraint", ROOT / "constraints.txt", "--dest", folder)
    run(sys.executable, "-m", "pip", "download", "--quiet", *wanted, *where, *BUNDLED)
    return sorted(wheel.name for wheel in folder.glob("*.whl"))


def build_with_wheels(plain: Path, python: str, target: str) -> Path:
    """From the plain zip, the one for a Python and a platform, beside it."""
    with tempfile.TemporaryDirectory() as temporary:
        staging = Path(temporary)
        with zipfile.ZipFile(plain) as archive:
            archive.extractall(staging)
        wheels = download_wheels(staging / "wheels", python, target)
        manifest = staging / "blender_manifest.toml"
        lines = [f'platforms = ["{target}"]', "wheels = [", *(f'    "./wheels/{name}",' for name in wheels), "]"]
        text = manifest.read_text()
        # Top-level keys stand before the first table.
        manifest.write_text(text.replace("\n[permissions]", "\n".join(["", *lines, "", "[permissions]"]), 1))
        tag = f"{target.replace('-', '_')}-cp{python.replace('.', '')}"
        return build(staging, plain.with_name(f"{plain.stem}-{tag}.zip"))


def main() -> None:
    """Build what the arguments say and print where it is."""
    parser = argparse.ArgumentParser(description="Build the Blender extension.")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder for the zips")
    parser.add_argument("--wheels", nargs="+", metavar="PYTHON", default=[], help="bundle wheels for these, e.g. 3.13")
    parser.add_argument("--platform", choices=sorted(PLATFORM_TAGS), help="of the wheels; by default this one")
    args = parser.parse_args()
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text())["version"]
    args.out.mkdir(parents=True, exist_ok=True)
    built = [build(ROOT, args.out.resolve() / f"patchnet-{version}.zip")]
    for python in args.wheels:
        built.append(build_with_wheels(built[0], python, args.platform or this_platform()))
    for path in built:
        print(f"{path}  {path.stat().st_size / 2**20:.1f} MiB")


if __name__ == "__main__":
    main()
