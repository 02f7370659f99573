# SPDX-License-Identifier: GPL-3.0-or-later
"""Networks of the literature that map the 1-sample picture to samples per pixel, retrained (methods 3.9-3.11)."""

NAMES = ("weiss", "kuznetsov", "unet")
