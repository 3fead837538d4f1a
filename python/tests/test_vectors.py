"""Force vectors: the same answers as `palpate solve`, to the last bit."""

import math
import subprocess

import numpy as np
import palpate
import pytest
from conftest import EXAMPLE

NUMBERS = [name for name, value in vars(palpate.VectorContact).items() if name[0] != "_" and name not in ("verdict", "unit", "error")]
COLUMNS = "force_x_n=force_x_n,force_y_n=force_y_n,force_n=force_n,outputs=out_1..out_27"
TAXELS = [(4.5 * (i % 3) - 4.5, 4.5 * (i // 3) - 4.5) for i in range(9)]


def outputs(x, y, force):
    """Three outputs of each of nine taxels, 5 mm deep: the traction of a force at a point of the surface."""
    lines = []
    for taxel in TAXELS:
        way = np.array([taxel[0] - x, taxel[1] - y, 5.0])
        length = math.sqrt(way @ way)
        lines.extend(15.0 * way / length**5 * (way @ force) * 5.0)
    return lines


@pytest.fixture(scope="module")
def presses(tmp_path_factory):
    rng = np.random.default_rng(4)
    rows = ["x_mm,y_mm,force_x_n,force_y_n,force_n," + ",".join(f"out_{i + 1}" for i in range(27))]
    for x in np.linspace(-5, 5, 5):
        for y in np.linspace(-5, 5, 5):
            for shear in [(0, 0), (0.4, 0), (-0.4, 0), (0, 0.4), (0, -0.4)]:
                force = np.array([*shear, 1.0])
                noisy = np.array(outputs(x, y, force)) + rng.normal(0, 0.002, 27)
                rows.append(",".join(map(repr, map(float, [x, y, *force, *noisy]))))
    path = tmp_path_factory.mktemp("vectors") / "presses.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_answers_have_the_bits_of_the_program(presses, program, tmp_path):
    model = palpate.fit_vector(presses, columns=COLUMNS)
    assert (model.outputs, model.knows_shear, model.x_mm) == (27, True, (-5.0, 5.0))
    model.save(tmp_path / "a.palpate")
    rng = np.random.default_rng(5)
    contacts = rng.uniform(-4, 4, (20, 2))
    readings = np.array([outputs(x, y, np.array([0.2, -0.1, 0.8])) for x, y in contacts]) + rng.normal(0, 0.002, (20, 27))
    readings[1] = 1e-5
    readings[2, 5] = np.nan
    readings[3] = np.nan
    frame = palpate.VectorModel.load(tmp_path / "a.palpate").solve(readings)
    lines = "\n".join(",".join(map(repr, map(float, reading))) for reading in readings)
    command = [program, "solve", "--model", tmp_path / "a.palpate", "--quiet"]
    printed = subprocess.run(command, input=lines, capture_output=True, text=True, check=True).stdout.splitlines()
    head, rows = printed[0].split(","), [line.split(",") for line in printed[1:]]
    for row, cells in enumerate(rows):
        contact, cells = model.solve(readings[row]), dict(zip(head, cells))
        for name in NUMBERS:
            expected = float(cells[name] or "nan")
            assert all(ours == expected or (math.isnan(ours) and math.isnan(expected)) for ours in (getattr(contact, name), frame[name][row]))
        assert contact.verdict == frame.verdict[row] == cells["verdict"]
    assert frame.verdict[1] == "weak-signal" and frame.error[3] == "every output is missing"
    solved = frame.verdict == "ok"
    assert solved.sum() >= 15
    assert np.hypot(frame.x_mm - contacts[:, 0], frame.y_mm - contacts[:, 1])[solved].max() < 0.2
    assert np.abs(frame.force_x_n - 0.2)[solved].mean() < 0.1


def test_a_model_of_another_kind_is_refused(presses, tmp_path):
    palpate.fit(EXAMPLE / "calibration.csv", "pearson").save(tmp_path / "a.palpate")
    with pytest.raises(palpate.UsageError, match="palpate.Model.load"):
        palpate.VectorModel.load(tmp_path / "a.palpate")
    palpate.fit_vector(presses).save(tmp_path / "b.palpate")
    with pytest.raises(palpate.UsageError, match="palpate.VectorModel.load"):
        palpate.Model.load(tmp_path / "b.palpate")
