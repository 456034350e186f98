# SPDX-License-Identifier: GPL-3.0-or-later
"""Declarations of every family's parameters, each fact once."""
