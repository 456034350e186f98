# SPDX-License-Identifier: GPL-3.0-or-later
"""What a scene does not need, by named rules with bounded effect."""
