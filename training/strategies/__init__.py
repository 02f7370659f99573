# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference strategies of the literature that need no training: what PatchNet is measured against, for research."""
