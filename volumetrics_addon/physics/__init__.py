# SPDX-License-Identifier: GPL-3.0-or-later
"""Physics of participating media as pure NumPy functions in SI units.

``phase`` scatters, and ``phase_fit`` finds its nearest two lobes; ``transmittance``, ``grid`` (voxels) and ``opacity_map``
(tables over depth) attenuate; ``airlight`` and ``projector`` sum single scattering along a ray; ``slab`` solves layers
with all orders of scattering, ``ambient_table`` holds those of a ball; ``atmosphere`` and ``preetham`` are the sky.
"""
