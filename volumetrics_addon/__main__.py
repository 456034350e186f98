# SPDX-License-Identifier: GPL-3.0-or-later
"""``python -m volumetrics_addon``."""

from .cli.main import main

raise SystemExit(main())
