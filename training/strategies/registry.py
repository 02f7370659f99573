# SPDX-License-Identifier: GPL-3.0-or-later
"""Research strategies by name: those of the panel, of the literature, and rivals with finer rays."""

from ...patchnet_addon.sampling.registry import STRATEGIES
from ...patchnet_addon.sampling.strategy import Strategy
from . import contrasts, fine_rays, plain_plus, ws_lut

_MODULES = fine_rays, plain_plus, contrasts, ws_lut
EVALUATED: dict[str, Strategy] = STRATEGIES | {each.name: each for module in _MODULES for each in module.STRATEGIES}
