"""What the tests share: the example data, and the program itself for comparison."""

import csv
import io
import os
import subprocess
from pathlib import Path

import numpy as np
import palpate
import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "data" / "example"
NUMBERS = [
    "x_mm",
    "y_mm",
    "force_n",
    "sd_x_mm",
    "sd_y_mm",
    "sd_force_n",
    "half68_mm",
    "half95_mm",
    "half68_n",
    "half95_n",
    "other_x_mm",
    "other_y_mm",
    "misfit",
    "relative_force",
    "half68_relative_force",
    "half95_relative_force",
]


@pytest.fixture(scope="session")
def program():
    """The program, to compare with: that of PALPATE_PROGRAM, or the one of the dev profile."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    path = Path(os.environ.get("PALPATE_PROGRAM", target / "debug" / "palpate"))
    if not path.exists():
        pytest.skip(f"{path} isn't built")
    return path


@pytest.fixture(scope="session")
def table():
    return palpate.load(EXAMPLE / "calibration.csv")


@pytest.fixture(scope="session")
def readings():
    """Readings of contacts, of no contact, of two contacts, and some with missing outputs."""
    random = np.random.default_rng(1)
    outputs = palpate.load(EXAMPLE / "test.csv").presses.outputs
    readings = outputs[random.integers(len(outputs), size=400)] * random.uniform(0.1, 2.0, (400, 1))
    readings += random.normal(0, 0.003, readings.shape)
    readings[:20] = random.normal(0, 0.001, (20, 9))
    readings[20:30] += readings[40:50]
    readings[30:34, 4] = np.nan
    readings[34] = np.nan
    readings[35] = 0.0
    return readings


@pytest.fixture(scope="session")
def solve_by_program(program):
    """Answers of `palpate solve`, as a dict of columns. A column that isn't printed is blank."""

    def solve(sensor_file, readings):
        header = ",".join(f"out_{output + 1}" for output in range(readings.shape[1]))
        rows = [",".join(repr(float(value)) for value in row) for row in readings]
        command = [program, "solve", "--model", sensor_file, "--keep-going", "--quiet"]
        done = subprocess.run(command, input="\n".join([header, *rows]) + "\n", capture_output=True, text=True, check=True)
        answers = list(csv.DictReader(io.StringIO(done.stdout)))
        return {name: [answer.get(name, "") for answer in answers] for name in [*answers[0], *NUMBERS]}

    return solve


@pytest.fixture
def recipe(tmp_path):
    """Makes a recipe of presses at random places, and returns its file."""

    def make(count):
        file = tmp_path / f"recipe-{count}.toml"
        area = "x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], force_n = [0.1, 1.0]"
        step = f'[[step]]\nphase = "test"\nrandom = {{ count = {count}, {area} }}\n'
        file.write_text(f'name = "r"\nrig = "sim"\n[press]\nsample_s = 0.02\n{step}')
        return file

    return make
