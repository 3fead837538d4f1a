#!/usr/bin/env python3
"""The characteristics of each unit, computed once more from a table of staircases.

Written from the definitions in words, with nothing but Python's standard library:

- A staircase belongs to the unit whose centre is closest. Its loading branch ends with its largest set force.
- Staircases at one place up to one force repeat each other: a series.
- Line: least squares over all loading outputs of a series against the load cell, intercept free.
- An output is brought to the set force: slope of the line times (set force - load cell) is added.
- Full scale: mean loading output at the unit's largest set force; of several places the largest.
- Repeatability: three standard deviations (n - 1) of the repeats of a level, pooled over levels but zero and over series.
- Its 95 % interval: chi-squared with n - 1 degrees of freedom for n staircases at a place; several series by Welch and
  Satterthwaite.
- Hysteresis: largest |mean unloading - mean loading output| over levels between zero and top force and over series, in % of
  full scale; and the largest of the same in % of the mean of both outputs.
- Linearity: largest |mean loading output of a level, 0 N included, - line at its set force|, over series, in % of full scale.
- Zero return: mean output at 0 N after the staircases less before them, as read; of several series the largest in magnitude.

usage: characteristics.py TABLE ROWS COLUMNS PITCH_MM
prints what `palpate run` writes to characteristics.csv
"""

import csv
import math
import sys
from collections import defaultdict

HEADER = (
    "unit,repeatability_loading_percent,repeatability_unloading_percent,hysteresis_percent,"
    "hysteresis_of_reading_percent,linearity_percent,zero_return_percent,"
    "repeatability_loading_least_percent,repeatability_loading_most_percent,"
    "repeatability_unloading_least_percent,repeatability_unloading_most_percent"
)


def mean(values):
    return math.fsum(values) / len(values)


def chi_squared_cdf(x, freedom):
    """The lower incomplete gamma function, regularised, by its power series."""
    a, half = freedom / 2, x / 2
    term = total = 1 / a
    n = a
    while term > 1e-17 * total:
        n += 1
        term *= half / n
        total += term
    return total * math.exp(-half + a * math.log(half) - math.lgamma(a))


def chi_squared_quantile(probability, freedom):
    least, most = 0.0, 10 * freedom + 100
    for _ in range(200):
        middle = (least + most) / 2
        if chi_squared_cdf(middle, freedom) < probability:
            least = middle
        else:
            most = middle
    return middle


class Series:
    """The staircases at one place up to one force."""

    def __init__(self, rows):
        loading = [(row["force"], row["output"]) for row in rows if row["loading"]]
        f, y = mean([p[0] for p in loading]), mean([p[1] for p in loading])
        self.slope = math.fsum((a - f) * (b - y) for a, b in loading) / math.fsum((a - f) ** 2 for a, b in loading)
        self.intercept = y - self.slope * f
        self.up, self.down = defaultdict(list), defaultdict(list)
        self.air_before, self.air_after = [], []
        for row in rows:
            brought = row["output"] + self.slope * (row["set"] - row["force"])
            (self.up if row["loading"] else self.down)[row["set"]].append(brought)
            if row["set"] == 0:
                (self.air_before if row["loading"] else self.air_after).append(row["output"])
        self.top = max(self.up)

    def inner(self):
        return [level for level in self.up if 0 < level < self.top and level in self.down]

    def gaps(self):
        return [(mean(self.down[level]), mean(self.up[level])) for level in self.inner()]


def repeatability(branches, full_scale):
    """The value and its interval, each in %, of the same branch of every series."""
    parts = []  # sum of squares, degrees of freedom, levels
    for branch in branches:
        levels = [outputs for level, outputs in branch.items() if level > 0 and len(outputs) > 1]
        if levels:
            squares = math.fsum((y - mean(outputs)) ** 2 for outputs in levels for y in outputs)
            parts.append((squares, sum(len(outputs) - 1 for outputs in levels), len(levels)))
    if not parts:
        return None, None, None
    squares = math.fsum(part[0] for part in parts)
    value = 3 * math.sqrt(squares / sum(part[1] for part in parts)) / full_scale * 100
    freedom = squares**2 / math.fsum(s**2 / (d / levels) for s, d, levels in parts)
    ends = [value * math.sqrt(freedom / chi_squared_quantile(p, freedom)) for p in (0.975, 0.025)]
    return value, ends[0], ends[1]


def characteristics(rows):
    grouped = defaultdict(list)
    for row in rows:
        grouped[row["place"], row["top"]].append(row)
    series = [Series(group) for group in grouped.values()]
    top = max(one.top for one in series)
    full_scale = max(abs(mean(one.up[top])) for one in series if one.top == top)
    percent = lambda value: 100 * value / full_scale
    loading = repeatability([one.up for one in series], full_scale)
    unloading = repeatability([one.down for one in series], full_scale)
    gaps = [gap for one in series for gap in one.gaps()]
    off = [
        abs(mean(outputs) - one.intercept - one.slope * level) for one in series for level, outputs in one.up.items()
    ]
    zeros = [mean(one.air_after) - mean(one.air_before) for one in series]
    return [
        loading[0],
        unloading[0],
        percent(max(abs(down - up) for down, up in gaps)),
        max(100 * abs((down - up) / ((down + up) / 2)) for down, up in gaps),
        percent(max(off)),
        percent(max(zeros, key=abs)),
        *loading[1:],
        *unloading[1:],
    ]


def main(table, rows, columns, pitch_mm):
    rows, columns, pitch_mm = int(rows), int(columns), float(pitch_mm)
    centres = [
        ((column - (columns - 1) / 2) * pitch_mm, (row - (rows - 1) / 2) * pitch_mm)
        for row in range(rows)
        for column in range(columns)
    ]
    staircases = defaultdict(list)
    with open(table, newline="") as file:
        for line in csv.DictReader(file):
            if line["phase"] == "characterisation":
                staircases[line["press"]].append(line)
    of_unit = defaultdict(list)
    for levels in staircases.values():
        forces = [float(level["force_set_n"]) for level in levels]
        top = forces.index(max(forces))
        for order, level in enumerate(levels):
            place = (float(level["x_mm"]), float(level["y_mm"]))
            unit = min(range(len(centres)), key=lambda unit: math.dist(place, centres[unit]))
            if not level["flags"]:
                row = {
                    "place": place,
                    "top": max(forces),
                    "loading": order <= top,
                    "set": forces[order],
                    "force": float(level["force_n"]),
                    "output": float(level[f"out_{unit + 1}"]),
                }
                of_unit[unit].append(row)
    print(HEADER)
    for unit in range(len(centres)):
        values = characteristics(of_unit[unit]) if of_unit[unit] else [None] * 10
        cells = ["" if value is None else f"{round(value, 4) + 0.0:.4f}" for value in values]
        print(",".join([str(unit + 1), *cells]))


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit("usage: characteristics.py TABLE ROWS COLUMNS PITCH_MM")
    main(*sys.argv[1:])
