# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet as it is trained: its layers over the occupied blocks of a batch, and their gradients."""
