"""Boosted trees, fitted to a table of presses, on another table: prints the mean location error, mm.

    boosted_trees.py CALIBRATION TEST

The trees see the reading over its length and the logarithm of the length, one model for x and one for y, and minimise the absolute
error, which bears outliers.
"""

import csv
import sys

import numpy
from sklearn.ensemble import HistGradientBoostingRegressor


def read(path):
    with open(path, newline="") as file:
        rows = [[float(cell) for cell in row] for row in list(csv.reader(file))[1:]]
    table = numpy.array(rows)
    outputs = table[:, 3:]
    length = numpy.linalg.norm(outputs, axis=1, keepdims=True)
    return table[:, :2], numpy.hstack([outputs / length, numpy.log(length)])


places, seen = read(sys.argv[1])
true_places, to_solve = read(sys.argv[2])
trees = [
    HistGradientBoostingRegressor(
        loss="absolute_error", max_iter=300, learning_rate=0.05, min_samples_leaf=5, random_state=0
    ).fit(seen, places[:, axis])
    for axis in range(2)
]
solved = numpy.stack([tree.predict(to_solve) for tree in trees], axis=1)
print(f"{numpy.hypot(*(solved - true_places).T).mean():.4f}")
