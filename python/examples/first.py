"""Fits the example calibration, solves 10,000 readings, and plots where the contacts are."""

import sys

import matplotlib
import numpy as np

import palpate

matplotlib.use("Agg")
import matplotlib.pyplot as plt

table, picture = sys.argv[1:] if len(sys.argv) == 3 else ("data/example/calibration.csv", "contacts.png")
run = palpate.load(table)
model = palpate.fit(run)

random = np.random.default_rng(1)
presses = random.integers(len(run), size=10_000)
readings = run.presses.outputs[presses] * random.uniform(0.2, 1.0, (10_000, 1)) + random.normal(0, 0.002, (10_000, model.outputs))
contacts = model.solve(readings)

error_mm = np.hypot(contacts.x_mm - run.presses.x_mm[presses], contacts.y_mm - run.presses.y_mm[presses])
print(f"{model.solver}: {len(contacts)} contacts, median location error {np.nanmedian(error_mm):.3f} mm")
plt.scatter(contacts.x_mm, contacts.y_mm, c=contacts.force_n, s=2)
plt.colorbar(label="force, N")
plt.gca().set(xlabel="x, mm", ylabel="y, mm", aspect="equal")
plt.savefig(picture)
