# SPDX-License-Identifier: GPL-3.0-or-later
"""PN+ strategy with coverage and luminance rendered from the patch: the expected pixel error (methods 3.12, 9)."""

import numpy as np

from .frame import Frame
from .patchnet_behind import expected_error
from .strategy import BEHIND, EXACT, Strategy


def _score(frame: Frame) -> np.ndarray:
    assert frame.exact is not None  # `needs` says so
    return expected_error(frame, frame.exact)


STRATEGY = Strategy(
    name="patchnet-behind-exact",
    title="PatchNet Behind, exact oracle",
    description="The expected error with the true coverage and luminance of the patch: what a perfect network would do",
    needs=frozenset({EXACT, BEHIND}),
    score=_score,
    quantity="expected luminance error",
    maximum=0.5,
)
