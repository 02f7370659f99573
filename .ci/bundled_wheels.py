# SPDX-License-Identifier: GPL-3.0-or-later
"""The wheels that the extension's zips bundle: for which platforms and Pythons, and that they are the known files.

    python .ci/bundled_wheels.py    write wheels.txt anew, with the versions of constraints.txt

wheels.txt names each version with the hashes of its files: a file that is not among them is not bundled.
"""

import platform
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
HASHES = Path(__file__).with_name("wheels.txt")
BUNDLED = ("llvmlite", "numba")
PLATFORM_TAGS = {  # as Blender calls the platform, as wheels do
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_12_0_arm64", "macosx_11_0_arm64"),
}
# First Blender with a Python, and the first that has it no longer.
BLENDERS = {"3.11": ("4.5.0", "5.1.0"), "3.13": ("5.1.0", None), "3.14": ("5.1.0", None)}


def this_platform() -> str:
    """Blender's name of the platform this runs on."""
    names = {("Linux", "x86_64"): "linux-x64", ("Windows", "AMD64"): "windows-x64", ("Darwin", "arm64"): "macos-arm64"}
    found = names.get((platform.system(), platform.machine()))
    if found is None:
        sys.exit(f"bundled_wheels: none for {platform.system()} {platform.machine()}; build without --wheels")
    return found


def download(folder: Path, python: str, target: str, *what: str | Path) -> None:
    """Fetch wheels for a Python and a platform; `what` tells pip which."""
    tags = [word for tag in PLATFORM_TAGS[target] for word in ("--platform", tag)]
    wanted = ("--no-deps", "--only-binary=:all:", "--implementation", "cp", "--python-version", python, *tags)
    command = (sys.executable, "-m", "pip", "--disable-pip-version-check", "download", "--quiet", *wanted)
    done = subprocess.run([*map(str, (*command, "--dest", folder, *what))], check=False)
    if done.returncode:
        sys.exit(
            f"bundled_wheels: pip found no wheels for Python {python} on {target}, or others than wheels.txt knows"
        )


def fetch(folder: Path, python: str, target: str) -> None:
    """Fetch the bundled wheels for a Python and a platform, those that wheels.txt knows."""
    download(folder, python, target, "--require-hashes", "--requirement", HASHES)


def pin() -> None:
    """Write wheels.txt: the versions of constraints.txt, and the hashes of their files on the package index."""
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
    """The requirement of one package, with a line for the hash of each of its files."""
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "hash", *map(str, files)]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    hashes = [line for line in said.splitlines() if line.startswith("--hash=")]
    name, version = files[0].name.split("-")[:2]
    return " \\\n".join([f"{name}=={version}", *(f"    {line}" for line in hashes)]) + "\n"


if __name__ == "__main__":
    pin()
