# SPDX-License-Identifier: GPL-3.0-or-later
"""World as cameras see it, behind all objects."""
