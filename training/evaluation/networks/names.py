# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of the map networks, for a help text that is there without torch."""

NAMES = ("weiss", "kuznetsov", "unet")
