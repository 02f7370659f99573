# SPDX-License-Identifier: GPL-3.0-or-later
"""Networks of the paper: of one scene each, without one, of each look-ahead, of each encoder, in one run."""
