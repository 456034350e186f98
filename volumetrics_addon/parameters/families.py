# SPDX-License-Identifier: GPL-3.0-or-later
"""The families, by name."""

from .air import AIR
from .cloud import CLOUD
from .fog import FOG
from .glass import GLASS
from .godray import GODRAY
from .model import Group

FAMILIES: dict[str, Group] = {family.name: family for family in (CLOUD, GLASS, FOG, GODRAY, AIR)}
