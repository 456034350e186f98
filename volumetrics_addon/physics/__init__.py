# SPDX-License-Identifier: GPL-3.0-or-later
"""Physics of participating media as pure NumPy functions in SI units.

``phase`` scatters, ``transmittance`` attenuates, ``airlight`` sums single
scattering along a ray.
"""
