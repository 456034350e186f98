# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line inside a Blender without the extension:

    blender --background --python scripts/volumetrics.py -- verify cumulus
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from volumetrics_addon.cli.main import main  # noqa: E402  (the path has to be there first)

arguments = sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else []
code = main(arguments)
sys.stdout.flush()
sys.stderr.flush()
sys.exit(code)
