# SPDX-License-Identifier: GPL-3.0-or-later
"""PN+ strategy with coverage and luminance rendered from the patch: the expected pixel error (methods 3.12, 9)."""

import numpy as np

from .patchnet_behind import expected_error
from .pixel_buffers import PixelBuffers
from .strategy import BEHIND, EXACT, Strategy


def _score(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.exact is not None  # `needs` says so
    return expected_error(buffers, buffers.exact)


STRATEGY = Strategy(
    name="patchnet-behind-exact",
    title="PatchNet Behind, exact oracle",
    description="The expected error with the true coverage and luminance of the patch: what a perfect network would do",
    needs=frozenset({EXACT, BEHIND}),
    score=_score,
    quantity="expected luminance error",
    maximum=0.5,
    group="oracle",
)
