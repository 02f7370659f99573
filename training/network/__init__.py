# SPDX-License-Identifier: GPL-3.0-or-later
"""Network as it is trained: its layers forward and backward on the CPU, losses, the optimiser."""
