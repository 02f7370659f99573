# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of settings that code asks for by name, and the stages of a job that settings belong to."""

from __future__ import annotations

AUTO = "AUTO"
SELECTED, VISIBLE = "SELECTED", "VISIBLE"
DEPTH, VOXEL_SIZE = "DEPTH", "VOXEL_SIZE"
CYCLES, TWO_LIGHTS = "cycles", "two-lights"
CPU, GPU = "CPU", "GPU"
WORLD, BLACK_BACKGROUND, TRANSPARENT = "world", "black", "transparent"
GLOSS_AUTO, GLOSS_OFF, GLOSS_ABOVE, GLOSS_CAMERA = "auto", "off", "above", "camera"
SIX_SIDES, ONE_SIDE = "six", "one"
EXACT_SHAPE, BOX_SHAPE, WHOLE_SHAPE = "exact", "boxes", "whole"
DIFFUSE, COMBINED = "diffuse", "combined"
SEEN_CELLS, ALL_CELLS = "seen", "everywhere"
NOTHING, IMAGE, VERTEX_GROUP = "NONE", "IMAGE", "VERTEX_GROUP"
# Stages of a job.
OCTREE, LIGHT, CODES, CAMERAS, VIEW, IMPORTANCE, OUTPUT, REFINEMENT = (
    "octree", "light", "codes", "cameras", "view", "importance", "output", "refinement",
)  # fmt: skip
RENDERS = "renders"  # of the render engine, which no job makes
JOB = (OCTREE, LIGHT, CODES, CAMERAS, VIEW, IMPORTANCE, OUTPUT)  # stages whose settings a job has
