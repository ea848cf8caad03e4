"""Linear recurrences along all segments at once, as one banded triangular system."""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import dtbsv

from autopilot.identification.forcing import Forcing
from autopilot.identification.runs import FloatArray


def recurrence(memory: FloatArray, source: FloatArray, initial: FloatArray, forcing: Forcing) -> FloatArray:
    """Return x at the nodes, shape (C, M+S), with x = `initial` at each segment's first node, shape (C, S), and
    x_k+1 = A_k x_k + b_k over each of M steps.

    memory: A, shape (C, C, M), C = 1 or 2; source: b, shape (C, M).
    """
    count = source.shape[0]
    nodes = forcing.step.size + forcing.first.size
    # the components of a node lie side by side, so that the next node's are `count` places further on
    band = np.zeros((2 * count, count * nodes), order="F")
    x = np.empty(count * nodes)
    for row in range(count):
        x[count * forcing.first + row] = initial[row]
        x[count * (forcing.begin + 1) + row] = source[row]
        for column in range(count):
            band[count + row - column, count * forcing.begin + column] = -memory[row, column]
    solved = dtbsv(2 * count - 1, band, x, lower=1, diag=1, overwrite_x=1)
    return np.ascontiguousarray(np.asarray(solved).reshape(nodes, count).T)
