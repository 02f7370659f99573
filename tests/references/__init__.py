# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain implementations that tests hold the fast ones against."""
