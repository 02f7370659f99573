# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of networks by what they have learned from: `station` from this scene alone, `without-station` from others."""

WITHOUT = "without-"
