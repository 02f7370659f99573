# SPDX-License-Identifier: GPL-3.0-or-later
"""Real spherical harmonics up to degree 4 (methods 6).

Orthonormal on the sphere, index l^2 + l + m, without the Condon-Shortley sign; the axes are those of the octree.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def harmonic_terms(x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """The 25 harmonics at unit vectors (x, y, z), one array each, in the type of the arguments.

    Only arithmetic is used, so NumPy and torch arrays work, and numbers in kernels.
    """
    xx, yy, zz, xy, yz, xz = x * x, y * y, z * z, x * y, y * z, x * z
    return (
        0.28209479177387814 + 0.0 * x,
        0.4886025119029199 * y,
        0.4886025119029199 * z,
        0.4886025119029199 * x,
        1.0925484305920792 * xy,
        1.0925484305920792 * yz,
        0.31539156525252005 * (3.0 * zz - 1.0),
        1.0925484305920792 * xz,
        0.5462742152960396 * (xx - yy),
        0.5900435899266435 * y * (3.0 * xx - yy),
        2.890611442640554 * xy * z,
        0.4570457994644658 * y * (5.0 * zz - 1.0),
        0.3731763325901154 * z * (5.0 * zz - 3.0),
        0.4570457994644658 * x * (5.0 * zz - 1.0),
        1.445305721320277 * z * (xx - yy),
        0.5900435899266435 * x * (xx - 3.0 * yy),
        2.5033429417967046 * xy * (xx - yy),
        1.7701307697799304 * yz * (3.0 * xx - yy),
        0.9461746957575601 * xy * (7.0 * zz - 1.0),
        0.6690465435572892 * yz * (7.0 * zz - 3.0),
        0.10578554691520431 * (35.0 * zz * zz - 30.0 * zz + 3.0),
        0.6690465435572892 * xz * (7.0 * zz - 3.0),
        0.47308734787878004 * (xx - yy) * (7.0 * zz - 1.0),
        1.7701307697799304 * xz * (xx - 3.0 * yy),
        0.6258357354491761 * (xx * xx - 6.0 * xx * yy + yy * yy),
    )


def real_harmonics(directions: np.ndarray, degree: int = 4) -> np.ndarray:
    """Harmonics (N, (degree + 1)^2) at unit vectors (N, 3), in their floating type."""
    x, y, z = np.asarray(directions).T
    return np.stack(harmonic_terms(x, y, z)[: (degree + 1) ** 2], axis=-1)
