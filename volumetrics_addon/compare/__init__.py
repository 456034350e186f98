# SPDX-License-Identifier: GPL-3.0-or-later
"""Comparison of renders with references: statistics with their own errors, and pictures of them."""
