# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the table of preintegrated ambient scattering that the package ships, or one of another precision."""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from volumetrics_addon.physics import ambient_table  # noqa: E402


def main(arguments=None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=2_000_000, help="path vertices per optical radius and anisotropy")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, default=ambient_table.DEFAULT)
    options = parser.parse_args(arguments)
    if options.samples < 1:
        parser.error(f"--samples must be >= 1, got {options.samples}")

    def progress(done: float) -> None:
        print(f"\r{done:4.0%}", end="", file=sys.stderr, flush=True)

    table = ambient_table.build(options.samples, options.seed, progress=progress)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    table.save(options.output)
    print(f"\r{options.output}: {table.log_ratio.size} entries, standard errors up to {table.error.max():.1%}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
