# SPDX-License-Identifier: GPL-3.0-or-later
"""The worst regions of a preview rendered by Cycles, within a budget (docs/cycles-refine.md)."""
