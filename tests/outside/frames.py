"""Reads the exports of a run with a library of others, and compares every number with the CSV export, bit for bit.

frames.py LIBRARY FOLDER: FOLDER has csv/, parquet/, arrow/, run.npz, run.mat and run.h5 of the same run.
"""

import csv
import glob
import json
import math
import os
import struct
import sys

library, folder = sys.argv[1:3]
compared = 0


def expected(table):
    with open(f"{folder}/csv/{table}.csv", newline="") as file:
        rows = list(csv.reader(file))
    return {name: [row[at] for row in rows[1:]] for at, name in enumerate(rows[0])}


def compare(table, name, cells, values):
    global compared
    assert len(cells) == len(values), (table, name, len(cells), len(values))
    for cell, value in zip(cells, values):
        if hasattr(value, "size") and value.size == 0:
            value = ""  # an empty text of MATLAB
        missing = value is None or value != value
        if cell == "":
            assert missing or value == "", (table, name, value)
        elif isinstance(value, str):
            assert value == cell, (table, name, cell, value)
        else:
            assert struct.pack("<d", float(cell)) == struct.pack("<d", float(value)), (table, name, cell, value)
        compared += 1


def tables():
    return sorted(os.path.basename(path)[:-4] for path in glob.glob(f"{folder}/csv/*.csv"))


def described(table):
    with open(f"{folder}/csv/{table}.json") as file:
        return json.load(file)


def units(table):
    return {column["name"]: (column["unit"], column["definition"]) for column in described(table)["columns"]}


if library == "numpy":
    import numpy

    arrays = numpy.load(f"{folder}/run.npz")
    assert json.loads(arrays["metadata.json"])[0]["manifest"]["status"] == "complete"
    for table in tables():
        cells = expected(table)
        for name in cells:
            if not name.startswith("out_"):
                compare(table, name, cells[name], arrays[f"{table}.{name}"].tolist())
        outputs = [name for name in cells if name.startswith("out_")]
        if outputs:
            assert arrays[f"{table}.outputs"].shape == (len(cells[outputs[0]]), len(outputs))
            for at, name in enumerate(outputs):
                compare(table, name, cells[name], arrays[f"{table}.outputs"][:, at].tolist())
elif library == "scipy":
    import scipy.io

    variables = scipy.io.loadmat(f"{folder}/run.mat", simplify_cells=True)
    assert json.loads(variables["manifest"])["status"] == "complete"
    for table in tables():
        cells, frame = expected(table), variables[table]
        named = {name for name in cells if not name.startswith("out_")}
        of = "units" if "unit" in named else "unit"
        for name in named:
            compare(table, name, cells[name], frame[name].tolist())
            assert (frame[of][name] if len(frame[of][name]) else "", frame["definition"][name]) == units(table)[name]
        for at, name in enumerate(name for name in cells if name.startswith("out_")):
            compare(table, name, cells[name], frame["outputs"][:, at].tolist())
elif library == "pandas":
    import pandas

    for table in tables():
        for frame in [pandas.read_parquet(f"{folder}/parquet/{table}.parquet"), pandas.read_feather(f"{folder}/arrow/{table}.arrow")]:
            cells = expected(table)
            assert list(frame.columns) == list(cells)
            for name in cells:
                compare(table, name, cells[name], frame[name].tolist())
elif library == "pyarrow":
    import pyarrow.feather
    import pyarrow.parquet

    for table in tables():
        for read in [pyarrow.parquet.read_table(f"{folder}/parquet/{table}.parquet"), pyarrow.feather.read_table(f"{folder}/arrow/{table}.arrow")]:
            cells = expected(table)
            assert json.loads(read.schema.metadata[b"palpate.manifest"]) == described(table)["manifest"]
            for name in cells:
                compare(table, name, cells[name], read[name].to_pylist())
                metadata = read.schema.field(name).metadata
                assert (metadata[b"unit"].decode(), metadata[b"definition"].decode()) == units(table)[name]
elif library == "polars":
    import polars

    for table in tables():
        for frame in [polars.read_parquet(f"{folder}/parquet/{table}.parquet"), polars.read_ipc(f"{folder}/arrow/{table}.arrow")]:
            cells = expected(table)
            for name in cells:
                compare(table, name, cells[name], frame[name].to_list())
elif library == "duckdb":
    import duckdb

    for table in tables():
        read = duckdb.sql(f"SELECT * FROM '{folder}/parquet/{table}.parquet'")
        rows, cells = read.fetchall(), expected(table)
        assert read.columns == list(cells)
        for at, name in enumerate(read.columns):
            compare(table, name, cells[name], [row[at] for row in rows])
elif library == "h5py":
    import h5py

    file = h5py.File(f"{folder}/run.h5")
    assert json.loads(file["manifest"][0])["status"] == "complete"
    for table in tables():
        cells, group = expected(table), file[table]
        for name in (name for name in cells if not name.startswith("out_")):
            values = group[name][()].tolist()
            compare(table, name, cells[name], [value.decode() if isinstance(value, bytes) else value for value in values])
            attributes = group[name].attrs
            assert (bytes(attributes.get("unit", b"")).decode(), attributes["definition"].decode()) == units(table)[name]
        for at, name in enumerate(name for name in cells if name.startswith("out_")):
            compare(table, name, cells[name], group["outputs"][:, at].tolist())
print(compared)
