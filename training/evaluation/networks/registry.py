# SPDX-License-Identifier: GPL-3.0-or-later
"""Map networks by name."""

from __future__ import annotations

from .kuznetsov import KUZNETSOV
from .map_network import MapNetwork
from .names import NAMES
from .unet import UNET
from .weiss import WEISS

NETWORKS: dict[str, MapNetwork] = dict(zip(NAMES, (WEISS, KUZNETSOV, UNET), strict=True))
