"""Compares `best` with regressions of scikit-learn on tables of presses.

    references.py PROGRAM FOLDER...

Each folder has calibration.csv and test.csv with x_mm, y_mm, an optional force_n and out_1 to out_n. For each folder a line shows the mean
location errors, mm, and the ratio of `best` to the best regression; the last line is the geometric mean of the ratios. Each regression sees
either the outputs or the reading divided by its length, whichever has the smaller error on five parts of the calibration. Inputs and places
are standardised; more than 40 inputs are replaced by 32 principal components for the Gaussian process.
"""

import csv
import json
import subprocess
import sys
import warnings
from pathlib import Path

import numpy
from sklearn.decomposition import PCA
from sklearn.ensemble import ExtraTreesRegressor, RandomForestRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel
from sklearn.model_selection import KFold
from sklearn.neighbors import KNeighborsRegressor
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

warnings.filterwarnings("ignore")  # fits that stop at a bound are used as they are
MOST_OF_PROCESS = 600


def read(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    names = [name for name in rows[0] if name.startswith("out_")]
    column = lambda names: numpy.array([[float(row[name]) for name in names] for row in rows])
    return column(["x_mm", "y_mm"]), column(names)


class Process:
    def fit(self, seen, places):
        few = numpy.random.default_rng(0).permutation(len(seen))[:MOST_OF_PROCESS]
        steps = [StandardScaler()]
        if seen.shape[1] > 40:
            steps += [PCA(32), StandardScaler()]
        self.view = make_pipeline(*steps).fit(seen[few])
        kernel = ConstantKernel() * Matern(numpy.sqrt(seen.shape[1]), nu=2.5) + WhiteKernel(1e-2)
        self.process = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0)
        self.process.fit(self.view.transform(seen[few]), places[few])
        return self

    def predict(self, seen):
        return self.process.predict(self.view.transform(seen))


class Network:
    def fit(self, seen, places):
        self.places = StandardScaler().fit(places)
        network = MLPRegressor(hidden_layer_sizes=(64, 64), max_iter=2000, tol=1e-6, n_iter_no_change=50, random_state=0)
        self.network = make_pipeline(StandardScaler(), network).fit(seen, self.places.transform(places))
        return self

    def predict(self, seen):
        return self.places.inverse_transform(self.network.predict(seen))


REFERENCES = {
    "knn": lambda: make_pipeline(StandardScaler(), KNeighborsRegressor(4, weights="distance")),
    "random forest": lambda: RandomForestRegressor(200, random_state=0, n_jobs=-1),
    "extra trees": lambda: ExtraTreesRegressor(200, random_state=0, n_jobs=-1),
    "gaussian process": Process,
    "mlp": Network,
}
VIEWS = {
    "outputs": lambda outputs: outputs,
    "direction": lambda outputs: outputs / numpy.linalg.norm(outputs, axis=1, keepdims=True).clip(1e-300),
}


def error_mm(solved, places):
    return float(numpy.hypot(*(solved - places).T).mean())


def cross_validated_mm(reference, seen, places):
    parts = KFold(5, shuffle=True, random_state=0).split(seen)
    return numpy.mean([error_mm(reference().fit(seen[a], places[a]).predict(seen[b]), places[b]) for a, b in parts])


def compared(program, folder):
    (places, outputs), (true_places, to_solve) = read(folder / "calibration.csv"), read(folder / "test.csv")
    errors = {}
    for name, reference in REFERENCES.items():
        view = min(VIEWS.values(), key=lambda view: cross_validated_mm(reference, view(outputs), places))
        errors[name] = error_mm(reference().fit(view(outputs), places).predict(view(to_solve)), true_places)
    command = [program, "evaluate", folder / "calibration.csv", folder / "test.csv", "--json"]
    best = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    best_mm = best["location_error_mm"]["mean"]
    ratio = best_mm / min(errors.values())
    others = ", ".join(f"{name} {mm:.3f}" for name, mm in errors.items())
    print(f"{folder.name}: best ({best['solver']}) {best_mm:.3f}, ratio {ratio:.3f}; {others}", flush=True)
    return ratio


ratios = [compared(sys.argv[1], Path(folder)) for folder in sys.argv[2:]]
print(f"geometric mean {numpy.exp(numpy.mean(numpy.log(ratios))):.3f}, largest {max(ratios):.3f}")
