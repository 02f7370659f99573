# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels of a job's steps in which a visit kills the engine; while Cycles bakes, the engine computes nothing."""

STAGES = (
    "Finding the depth", "Choosing surfels", "Baking light", "Filtering light", "Finding corners",
    "Tracing the preview", "Ranking pixels", "Refining", "Preparing pictures",
)  # fmt: skip
