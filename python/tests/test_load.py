"""Runs and tables as frames, and what reads them."""

import csv
import json

import numpy as np
import palpate
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from conftest import EXAMPLE


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return palpate.simulate(EXAMPLE / "short.toml", out=tmp_path_factory.mktemp("runs") / "short", seed=3)


def rows_of(file):
    with open(file, newline="") as text:
        return list(csv.DictReader(text))


def test_a_run_is_its_tables(run):
    rows = rows_of(run.path / "presses.csv")
    presses = run.presses
    assert (len(run), len(presses), presses.columns) == (len(rows), len(rows), list(rows[0]))
    for name in presses.columns:
        expected = [row[name] for row in rows]
        column = presses[name]
        assert column.shape == (len(rows),) and not column.flags.writeable
        if column.dtype.kind in "fi":
            expected = np.array([float(cell) if cell else np.nan for cell in expected])
            np.testing.assert_array_equal(column, expected, err_msg=name)
        else:
            assert [cell or "" for cell in column] == expected, name
    assert presses.x_mm is presses["x_mm"]
    assert presses.outputs.shape == (len(rows), 9) and presses.outputs[5, 2] == presses.out_3[5]
    assert (presses.units["x_mm"], presses.units["force_n"], presses.units["out_1"]) == ("mm", "N", "V")
    assert presses.definitions["x_mm"] == "x of the press, specimen frame, mm."
    assert run.manifest["recipe"] == "short" and run.manifest["seed"] == 3
    assert set(run.frames) == {"presses", "calibration_matrix", "test_matrix", "characteristics", "truth"}
    assert len(run.calibration_matrix) == 49 and len(run.test_matrix) == 60 and len(run.truth) == len(run)


def test_other_programs_take_a_frame(run):
    presses = run.presses
    pandas, polars, arrow = pd.DataFrame.from_arrow(presses), pl.DataFrame(presses), pa.table(presses)
    assert list(pandas.columns) == polars.columns == arrow.column_names == presses.columns
    for name in ["press", "x_mm", "force_n", "out_9"]:
        np.testing.assert_array_equal(pandas[name].to_numpy(), presses[name])
        np.testing.assert_array_equal(polars[name].to_numpy(), presses[name])
        np.testing.assert_array_equal(arrow[name].to_numpy(), presses[name])
    assert polars["u_force_n"].null_count() == len(presses) and pandas["u_force_n"].isna().all()
    assert polars["phase"].unique().sort().to_list() == ["calibration", "characterisation", "test"]
    field = arrow.schema.field("force_n")
    assert field.metadata[b"unit"] == b"N" and field.metadata[b"definition"].startswith(b"Mean force in the window")
    assert json.loads(arrow.schema.metadata[b"palpate.manifest"])["recipe"] == "short"


def test_a_frame_is_taken_without_a_copy(run):
    def address(table):
        return table["out_1"].chunk(0).buffers()[1].address

    first, second = pa.table(run.presses), pa.table(run.presses)
    assert address(first) == address(second)
    polars = pl.DataFrame(run.presses)["out_1"]
    assert polars.to_numpy(allow_copy=False).__array_interface__["data"][0] == address(first)
    pandas = pa.table(run.presses).to_pandas(types_mapper=pd.ArrowDtype)["out_1"]
    assert address(pa.table({"out_1": pandas.array.__arrow_array__()})) == address(first)
    del first, second
    assert polars.sum() == pytest.approx(run.presses.out_1.sum())


def test_a_table_is_one_too(tmp_path):
    table = palpate.load(EXAMPLE / "calibration.csv")
    assert (len(table), table.manifest, table.truth) == (169, None, None)
    (tmp_path / "grid.csv").write_text("X;Y;ch0;ch1\n0;0;0,5;1\n1;0;0,25;2\n")
    table = palpate.load(tmp_path / "grid.csv", columns="x_mm=X,y_mm=Y,outputs=ch0..ch1")
    np.testing.assert_array_equal(table.presses.outputs, [[0.5, 1], [0.25, 2]])
    with pytest.warns(UserWarning, match="no force_n in the calibration"):
        assert palpate.fit(table, "pearson").outputs == 2


def test_what_is_no_run_is_refused_in_the_words_of_the_command(tmp_path):
    with pytest.raises(palpate.UsageError, match="no-such") as refused:
        palpate.load(tmp_path / "no-such")
    assert refused.value.code == 2 and isinstance(refused.value, palpate.Error)
    with pytest.raises(palpate.UsageError, match="isn't a run|no run|journal"):
        palpate.load(tmp_path)


def test_a_changed_table_of_a_run_is_warned_of(run):
    table = run.path / "presses.csv"
    text = table.read_bytes()
    try:
        table.write_bytes(text.replace(b"calibration", b"test", 1))
        with pytest.warns(UserWarning, match="presses.csv differs from the journal"):
            palpate.load(run.path)
    finally:
        table.write_bytes(text)


def test_an_unknown_column_is_an_error(run):
    with pytest.raises(KeyError):
        run.presses["nothing"]
    with pytest.raises(AttributeError, match="no column nothing"):
        run.presses.nothing
    assert "x_mm" in run.presses and "nothing" not in run.presses and "x_mm" in dir(run.presses)
