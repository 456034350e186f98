# SPDX-License-Identifier: GPL-3.0-or-later
"""Says at the end of a run how many elements were asserted, so that a suite that checks nothing is seen."""

from .cases import asserted, functions, integrators


def pytest_terminal_summary(terminalreporter):
    if asserted:
        by_part = ", ".join(f"{part} {elements:,}" for part, elements in sorted(asserted.items()))
        terminalreporter.write_line(
            f"stability: {asserted.total():,} cases of {len(functions)} functions and "
            f"{len(integrators)} integrators ({by_part})"
        )
