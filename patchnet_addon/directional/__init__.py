# SPDX-License-Identifier: GPL-3.0-or-later
"""Light by direction (methods 7.2i): of leaves, of levels above them, and of nodes that rays meet."""
