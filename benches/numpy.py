"""What the same search costs as a matrix product: one product of all readings with the table, then the largest of each
row. Double precision, one thread (the caller limits the threads before this starts). Prints nanoseconds a reading.

Usage: numpy.py UNITS POINTS READINGS
"""

import sys
import time

sys.path.pop(0)  # where this file itself would be found as numpy
import numpy as np

REPETITIONS = 7

units, points, readings = map(int, sys.argv[1:])
random = np.random.default_rng(1)
table = random.standard_normal((units, points))
table /= np.linalg.norm(table, axis=0)
directions = random.standard_normal((readings, units))
directions /= np.linalg.norm(directions, axis=1, keepdims=True)
scores = np.empty((readings, points))

best_s = float("inf")
for _ in range(REPETITIONS):
    began = time.perf_counter()
    np.matmul(directions, table, out=scores)
    scores.argmax(axis=1)
    best_s = min(best_s, time.perf_counter() - began)
print(f"{best_s / readings * 1e9:.1f}")
