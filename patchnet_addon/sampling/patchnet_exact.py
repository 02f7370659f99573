# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet strategy with coverage and luminance rendered from the patch: the limit of any network (methods 9)."""

import numpy as np

from .patchnet import coverage_and_luminance_score
from .pixel_buffers import PixelBuffers
from .strategy import EXACT, Strategy


def _score(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.exact is not None  # `needs` says so
    return coverage_and_luminance_score(buffers, buffers.exact)


STRATEGY = Strategy(
    name="patchnet-exact",
    title="PatchNet (paper), exact oracle",
    description="The paper's score with the true coverage and luminance of the patch: what a perfect network would do",
    needs=frozenset({EXACT}),
    score=_score,
    quantity="coverage + 5 x luminance",
    maximum=2.0,
    group="oracle",
)
