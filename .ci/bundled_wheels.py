# SPDX-License-Identifier: GPL-3.0-or-later
"""Wheels bundled in the extension's zips: platforms, Pythons, and a check of the files' hashes.

    python .ci/bundled_wheels.py    update wheels.txt, with the versions of constraints.txt

wheels.txt lists each version with the hashes of its files; other files are not bundled.
"""

import platform
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
HASHES = Path(__file__).with_name("wheels.txt")
BUNDLED = ("llvmlite", "numba")
PLATFORM_TAGS = {  # platform names of Blender and of wheels
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_12_0_arm64", "macosx_11_0_arm64"),
}
# First Blender with a Python, and the first Blender after it without.
BLENDERS = {"3.11": ("4.5.0", "5.1.0"), "3.13": ("5.1.0", None), "3.14": ("5.1.0", None)}


def this_platform() -> str:
    """Blender's name of this platform."""
    names = {("Linux", "x86_64"): "linux-x64", ("Windows", "AMD64"): "windows-x64", ("Darwin", "arm64"): "macos-arm64"}
    found = names.get((platform.system(), platform.machine()))
    if found is None:
        sys.exit(f"bundled_wheels: no wheels for {platform.system()} {platform.machine()}; build without --wheels")
    return found


def download(folder: Path, python: str, target: str, *what: str | Path) -> None:
    """Download wheels for a Python and a platform; `what`: arguments of pip that name them."""
    tags = [word for tag in PLATFORM_TAGS[target] for word in ("--platform", tag)]
    wanted = ("--no-deps", "--only-binary=:all:", "--implementation", "cp", "--python-version", python, *tags)
    command = (sys.executable, "-m", "pip", "--disable-pip-version-check", "download", "--quiet", *wanted)
    done = subprocess.run([*map(str, (*command, "--dest", folder, *what))], check=False)
    if done.returncode:
        sys.exit(
            f"bundled_wheels: pip found no wheels for Python {python} on {target}, or others than wheels.txt knows"
        )


def fetch(folder: Path, python: str, target: str) -> None:
    """Download the wheels of wheels.txt for a Python and a platform."""
    download(folder, python, target, "--require-hashes", "--requirement", HASHES)


def pin() -> None:
    """Write wheels.txt: versions of constraints.txt, and hashes of their files on the package index."""
    with tempfile.TemporaryDirectory() as temporary:
        for python in BLENDERS:
            for target in PLATFORM_TAGS:
                download(Path(temporary), python, target, "--constraint", ROOT / "constraints.txt", *BUNDLED)
        files = sorted(Path(temporary).glob("*.whl"))
        HASHES.write_text(
            "# Written by bundled_wheels.py: what the extension's zips bundle, for all platforms and Pythons.\n"
            + "".join(_lines([path for path in files if path.name.startswith(f"{name}-")]) for name in BUNDLED)
        )


def _lines(files: list[Path]) -> str:
    """Requirement of one package, with a line per hash of its files."""
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "hash", *map(str, files)]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    hashes = [line for line in said.splitlines() if line.startswith("--hash=")]
    name, version = files[0].name.split("-")[:2]
    return " \\\n".join([f"{name}=={version}", *(f"    {line}" for line in hashes)]) + "\n"


if __name__ == "__main__":
    pin()
