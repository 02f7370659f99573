# SPDX-License-Identifier: GPL-3.0-or-later
"""Make cycles-refine.jpg: preview, heatmap of the chosen pixels, Cycles over the preview, and a full render by Cycles.

    python docs/pictures/make_cycles_refine.py [WIDTH HEIGHT SAMPLES BUDGET [CAMERA]]

Prints the figures, too; times depend on the machine. The picture is of the camera Middle; other cameras have figures
only. Needs the extras `blender` and `bench`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy  # noqa: TID251
from PIL import Image

from patchnet.__main__ import leave
from patchnet.commands.run import run_with_lines
from patchnet.operators.demo_scene import build_courtyard
from patchnet.operators.pipeline.cycles_pictures import comparison_sheet
from patchnet.operators.settings.cycles_settings import CyclesSettings
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.image.tone import to_bytes
from patchnet.patchnet_addon.sampling.registry import strategy

PICTURED = "Middle"


def main() -> None:
    """Write cycles-refine.jpg beside this file."""
    defaults = ("240", "180", "16", "0.2", PICTURED)
    width, height, samples, budget, camera = (*sys.argv[1:], *defaults[len(sys.argv) - 1 :])
    bpy.ops.wm.read_homefile(use_empty=True)
    build_courtyard(bpy.context.scene)
    bpy.context.view_layer.update()
    settings = JobSettings.of(
        cameras=(camera,),
        size=(int(width), int(height)),
        color=True,
        cycles=CyclesSettings(float(budget), int(samples), compare=True),
    )
    result = run_with_lines(settings)
    (view,) = result.cycles
    print(json.dumps(view.report, indent=2))
    if camera == PICTURED:
        sheet = comparison_sheet(view, strategy(settings.view.strategy).maximum)
        Image.fromarray(to_bytes(sheet[::-1])).save(Path(__file__).with_name("cycles-refine.jpg"), quality=80)
    leave(0)


if __name__ == "__main__":
    main()
