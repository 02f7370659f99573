# SPDX-License-Identifier: GPL-3.0-or-later
"""Network as a torch module, losses, and the optimizer."""
