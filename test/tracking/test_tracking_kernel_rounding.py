"""Kernels that may reorder sums give the same boxes whether they were compiled just now or come from the cache."""

import pytest
from numba.core.dispatcher import Dispatcher

from etd_ros.tracking import box_network, cell_trust, contour_drawing, contour_kernels

MODULES = [box_network, cell_trust, contour_drawing, contour_kernels]


def kernels_of(module):
    return {name: value for name, value in vars(module).items() if isinstance(value, Dispatcher)}


@pytest.mark.parametrize("module", MODULES)
def test_what_a_kernel_calls_is_put_into_it(module):
    kernels = kernels_of(module)
    called = {name for kernel in kernels.values() for name in kernel.py_func.__code__.co_names if name in kernels}
    assert called
    assert not [name for name in called if not kernels[name].targetoptions.get("forceinline")]
