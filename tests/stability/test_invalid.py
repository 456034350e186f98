# SPDX-License-Identifier: GPL-3.0-or-later
"""Every argument of every public function at every value it must refuse: ValueError with name, value and remedy."""

import numpy as np
import pytest

from .cases import count, numbers, usual
from .declared import FUNCTIONS

CHECKED = [name for name, function in FUNCTIONS.items() if function.arguments and not function.unchecked]


def assert_refused(function, arguments, name, quoted):
    with pytest.raises(ValueError) as caught:
        function(**arguments)
    message = str(caught.value)
    sentence, _, remedy = message.partition("; ")
    says = function.names.get(name, name)
    assert says in sentence, f"{says!r} is not named: {message}"
    assert quoted in sentence, f"{quoted} is not quoted: {message}"
    assert len(remedy) >= 8, f"no remedy: {message}"


@pytest.mark.parametrize("name", CHECKED)
def test_invalid(name):
    function = FUNCTIONS[name]
    arrays = numbers(function)
    total = 0
    for argument, kind in function.arguments.items():
        for value, quoted in kind.invalid:
            assert_refused(function, usual(function) | {argument: value}, argument, quoted)
            total += 1
            if argument in arrays and np.shape(value) == kind.shape:
                # In the midst of valid elements it is found and quoted all the same.
                hidden = np.array([kind.usual, value, kind.usual])
                assert_refused(function, usual(function) | {argument: hidden}, argument, quoted)
                total += 1
    assert total
    count("invalid", name, total)
