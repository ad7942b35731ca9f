# SPDX-License-Identifier: MIT
"""Copies of arrays inside kernels."""

import numpy as np

from slam._array_kernels import copy_matrix, copy_values


def test_as_many_values_are_copied_as_there_is_room_for():
    source, out = np.arange(5.0), np.full((2, 3), -1.0)
    copy_values(source, out[1])
    np.testing.assert_array_equal(out, [[-1.0, -1.0, -1.0], [0.0, 1.0, 2.0]])


def test_a_matrix_is_copied_into_a_part_of_another():
    source, out = np.arange(6.0).reshape(2, 3), np.zeros((3, 2, 3))
    copy_matrix(source, out[1])
    np.testing.assert_array_equal(out[1], source)
    assert not out[0].any()
    assert not out[2].any()
