"""Linear recurrences along all segments at once, as one banded triangular system."""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import dtbsv

from autopilot.identification.forcing import Forcing
from autopilot.identification.runs import FloatArray


class Recurrence:
    """x_k+1 = A_k x_k + b_k over each of M steps, for one A and one source b after the other.

    memory: A, shape (C, C, M), C = 1 or 2.
    """

    def __init__(self, memory: FloatArray, forcing: Forcing) -> None:
        self._forcing, count = forcing, memory.shape[0]
        # the components of a node lie side by side, so that the next node's are `count` places further on
        self._band = np.zeros((2 * count, count * (forcing.step.size + forcing.first.size)), order="F")
        for row in range(count):
            for column in range(count):
                self._band[count + row - column, count * forcing.begin + column] = -memory[row, column]

    def solved(self, source: FloatArray, initial: FloatArray) -> FloatArray:
        """Return x at the nodes, shape (C, M+S), with x = `initial` at each segment's first node, shape (C, S).

        source: b, shape (C, M).
        """
        forcing, count = self._forcing, source.shape[0]
        x = np.empty(self._band.shape[1])
        for row in range(count):
            x[count * forcing.first + row] = initial[row]
            x[count * (forcing.begin + 1) + row] = source[row]
        found = dtbsv(2 * count - 1, self._band, x, lower=1, diag=1, overwrite_x=1)
        return np.ascontiguousarray(np.asarray(found).reshape(-1, count).T)
