# SPDX-License-Identifier: GPL-3.0-or-later
"""Unbiased settings of Cycles, the same for bakes and for the renders that they are compared with."""

from __future__ import annotations

from typing import Any

# As many paths as were asked for, none of them darkened; bounces and light stay the user's.
UNBIASED: dict[str, Any] = {
    "use_animated_seed": False,
    "use_adaptive_sampling": False,
    "use_denoising": False,
    "sample_clamp_direct": 0.0,
    "sample_clamp_indirect": 0.0,
    "film_exposure": 1.0,
    "time_limit": 0.0,
    "use_sample_subset": False,
}
