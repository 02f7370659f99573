# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the Blender extension: a plain zip, and zips with the wheels that Blender does not have.

    python .ci/build_extension.py --out dist                             patchnet-1.0.0.zip, without wheels
    python .ci/build_extension.py --out dist --wheels 3.11 3.13          also one each, for this platform
    python .ci/build_extension.py --out dist --wheels all --platform all every Python on every platform
    python .ci/build_extension.py --out dist --wheels 3.11 3.13 --together --platform all
                                  one a platform with the wheels of both, for extensions.blender.org

Blender's own validator and builder, from the installed `bpy`, do the work. A zip holds the wheels of one platform and
one Python, because llvmlite alone is 57 MiB. NumPy is never bundled: Blender brings its own.
"""

import argparse
import importlib.util
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path

from bundled_wheels import BLENDERS, BUNDLED, PLATFORM_TAGS, ROOT, fetch, this_platform

# All that runs in Blender, with the licence and the weights' own description.
FILES = {"__init__.py", "blender_manifest.toml", "LICENSE"}
FOLDERS = {"commands", "operators", "patchnet_addon"}
SUFFIXES = {".py", ".glsl", ".safetensors", ".json", ".md"}


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


def strangers(names: Iterable[str], wheels: Iterable[str] = ()) -> list[str]:
    """Find faults among the paths in a zip: those that do not belong there, or should and do not, sorted.

    wheels: the wheels that belong there; one that is not of a bundled package never does.
    """
    expected = {f"wheels/{name}" for name in wheels if name.partition("-")[0] in BUNDLED}
    found = set(names)
    ours = {name for name in found if name.partition("/")[0] in FOLDERS and Path(name).suffix in SUFFIXES}
    missing = {f"no {name}" for name in (FILES | expected) - found}
    return sorted((found - ours - FILES - expected) | missing)


def build(source: Path, out: Path, wheels: Sequence[str] = ()) -> Path:
    """Validate the extension in `source`, build the zip file `out`, validate that too, and look at what is in it."""
    tool = blender_tool()
    run(sys.executable, tool, "validate", source)
    run(sys.executable, tool, "build", "--source-dir", source, "--output-filepath", out)
    run(sys.executable, tool, "validate", out)
    with zipfile.ZipFile(out) as archive:
        wrong = strangers((name for name in archive.namelist() if not name.endswith("/")), wheels)
    if wrong:
        sys.exit(f"build_extension: in {out.name}: {', '.join(wrong)}; see [build] in blender_manifest.toml")
    return out


def with_wheels_named(manifest: str, target: str, pythons: Sequence[str], wheels: Sequence[str]) -> str:
    """The manifest's text with the wheels, the platform they are for, and the Blenders that have these Pythons."""
    first, last = BLENDERS[pythons[0]][0], BLENDERS[pythons[-1]][1]
    old = f'blender_version_min = "{BLENDERS["3.11"][0]}"\n'
    if manifest.count(old) != 1:
        sys.exit(f"build_extension: blender_manifest.toml should say {old.strip()}, as bundled_wheels.py does")
    lines = [f'blender_version_min = "{first}"', *([f'blender_version_max = "{last}"'] if last else [])]
    lines += [f'platforms = ["{target}"]', "wheels = [", *(f'    "./wheels/{name}",' for name in wheels), "]", ""]
    return manifest.replace(old, "\n".join(lines))


def build_with_wheels(plain: Path, target: str, pythons: Sequence[str]) -> Path:
    """From the plain zip, the one for some Pythons, in ascending order, and a platform of computers, beside it."""
    with tempfile.TemporaryDirectory() as temporary:
        staging = Path(temporary)
        with zipfile.ZipFile(plain) as archive:
            archive.extractall(staging)
        for python in pythons:
            fetch(staging / "wheels", python, target)
        wheels = sorted(wheel.name for wheel in (staging / "wheels").glob("*.whl"))
        manifest = staging / "blender_manifest.toml"
        manifest.write_text(with_wheels_named(manifest.read_text(), target, pythons, wheels))
        tags = [target.replace("-", "_"), *(f"cp{python.replace('.', '')}" for python in pythons)]
        return build(staging, plain.with_name("-".join([plain.stem, *tags]) + ".zip"), wheels)


def main() -> None:
    """Build what the arguments say and print where it is."""
    parser = argparse.ArgumentParser(description="Build the Blender extension.")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder for the zips")
    parser.add_argument("--wheels", nargs="+", choices=[*BLENDERS, "all"], default=[], help="bundle those of a Python")
    parser.add_argument("--platform", choices=[*PLATFORM_TAGS, "all"], help="of the wheels; by default this one")
    parser.add_argument(
        "--together", action="store_true", help="the wheels of all these Pythons in one zip, for extensions.blender.org"
    )
    args = parser.parse_args()
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text())["version"]
    args.out.mkdir(parents=True, exist_ok=True)
    built = [build(ROOT, args.out.resolve() / f"patchnet-{version}.zip")]
    chosen = [python for python in BLENDERS if {python, "all"} & set(args.wheels)]
    groups = [chosen] if args.together else [[python] for python in chosen]
    for target in PLATFORM_TAGS if args.platform == "all" else [args.platform or this_platform()] if chosen else []:
        built += [build_with_wheels(built[0], target, group) for group in groups]
    for path in built:
        print(f"{path}  {path.stat().st_size / 2**20:.1f} MiB")


if __name__ == "__main__":
    main()
