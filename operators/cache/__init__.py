# SPDX-License-Identifier: GPL-3.0-or-later
"""The cache folder: what of it is ours, how large it is, and making room."""
