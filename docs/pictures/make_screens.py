# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the screenshots of the documentation from a real Blender, with the extension installed from its zip.

    python docs/pictures/make_screens.py [--parts PART ...] [NAME ...]

BLENDER=/path/to/blender, or BLENDER_ROOT as for `make test-blender`. Writes to out/screens. PARTs: parts of screens.py.
NAMEs: pictures to copy from there, without ".png". The default is all. Needs xvfb-run, ImageMagick and Pillow.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from patchnet.tests.real_blender.executable import ROOT, Blender

OUT = ROOT / "out" / "screens"
HERE = Path(__file__).parent
MOST_BYTES = 300_000
MOST_PX = 1200
SCREEN = (1400, 900)
PREFERENCES = (283, 218, 968, 486)  # left, upper, right, lower: without the path of the installation


def blender() -> Blender:
    """Blender with separate user resources."""
    environment = {"BLENDER_USER_RESOURCES": str(OUT / "resources")}
    (OUT / "resources").mkdir()
    if named := os.environ.get("BLENDER"):
        return Blender((), named, environment)
    root = Path(os.environ.get("BLENDER_ROOT") or ROOT / ".blender-root").absolute()
    return Blender((str(ROOT / ".ci" / "blender-root"), str(root)), "blender", environment)


def install(program: Blender) -> None:
    """Build the zip for this Blender's Python and install it."""
    python = program.value("'%d.%d' % sys.version_info[:2]")
    build = [sys.executable, ROOT / ".ci" / "build_extension.py", "--out", OUT / "zips", "--wheels", python]
    subprocess.run(build, check=True, capture_output=True)
    (archive,) = (OUT / "zips").glob("*-cp*.zip")
    done = program.run("--command", "extension", "install-file", "-r", "user_default", "--enable", archive)
    if done.returncode:
        raise SystemExit(done.stdout + done.stderr)


def without_margin(pixels: np.ndarray) -> np.ndarray:
    """A panel (H, W, 3) without the empty rows below it."""
    rows = np.flatnonzero(np.ptp(pixels[:, 8:-40].reshape(len(pixels), -1, 3).astype(int), axis=1).max(axis=1) > 12)
    return pixels[: min(int(rows[-1]) + 10, len(pixels))] if len(rows) else pixels


def take_over(path: Path) -> None:
    """Write a small version of a screenshot beside this file: panels as PNG, others as JPEG."""
    picture = Image.open(path).convert("RGB")
    if path.stem.startswith("panel-"):
        picture = Image.fromarray(without_margin(np.asarray(picture)))
    if path.stem == "preferences":
        picture = picture.crop(PREFERENCES)
    picture.thumbnail((MOST_PX, MOST_PX))
    made = HERE / path.name
    picture.quantize(256, dither=Image.Dither.NONE).save(made, optimize=True)
    if not path.stem.startswith("panel-"):
        made.unlink()
        made = made.with_suffix(".jpg")
        picture.save(made, quality=85, optimize=True)
    if made.stat().st_size > MOST_BYTES:
        raise SystemExit(f"{made} has {made.stat().st_size} bytes, more than {MOST_BYTES}: lower MOST_PX")


def main() -> None:
    """Make all pictures in an empty folder."""
    parser = argparse.ArgumentParser(description="Make the screenshots of the documentation.")
    parser.add_argument("names", nargs="*")
    parser.add_argument("--parts", nargs="+", default=[])
    args = parser.parse_args()
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    program = blender()
    install(program)
    done = program.run_window("-P", HERE / "screens.py", "--", OUT, *args.parts, seconds=3000.0, screen=SCREEN)
    (OUT / "screens.log").write_text(done.stdout + done.stderr)
    for path in sorted(OUT.glob("*.png")):
        if not args.names or path.stem in args.names:
            take_over(path)
    problem = OUT / "screens.txt"
    if not problem.exists() or problem.read_text():
        raise SystemExit(problem.read_text() if problem.exists() else f"Blender ended early: see {OUT / 'screens.log'}")


if __name__ == "__main__":
    main()
