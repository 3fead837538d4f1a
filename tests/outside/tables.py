"""Writes the table of a CSV file as the files that people have: tables.py CSV FOLDER."""

import csv
import sys

import numpy
import openpyxl
import pandas
import polars
import scipy.io

table, folder = sys.argv[1:3]
with open(table, newline="") as file:
    rows = list(csv.reader(file))
names, rows = rows[0], [[float(cell) for cell in row] for row in rows[1:]]
columns = {name: numpy.array([row[at] for row in rows]) for at, name in enumerate(names)}

book = openpyxl.Workbook()
book.active.title = "Notes"
book.active.append(["made by hand"])
sheet = book.create_sheet("Data")
sheet.append([])
sheet.append(names)
for row in rows:
    sheet.append(row)
book.save(f"{folder}/two.xlsx")
del book["Notes"]
book.save(f"{folder}/one.xlsx")
# openpyxl writes 16 digits: what it reads again is compared
again = list(openpyxl.load_workbook(f"{folder}/one.xlsx")["Data"].values)
with open(f"{folder}/sheet.csv", "w", newline="") as file:
    csv.writer(file).writerows(row for row in again if row[0] is not None)
sheet.cell(row=8, column=2).value = "n.a."
book.save(f"{folder}/wrong.xlsx")
sheet.cell(row=1_000_000, column=16_000).value = 1.0  # the rectangle up to there doesn't fit into memory
book.save(f"{folder}/far.xlsx")

outputs = numpy.stack([columns[name] for name in names if name.startswith("ch")], axis=1)
places = {name: columns[name] for name in names if not name.startswith("ch")}
numpy.savez(f"{folder}/columns.npz", **columns)
numpy.savez_compressed(f"{folder}/matrix.npz", **places, ch=outputs, rate_hz=numpy.array(1000.0), spare=numpy.zeros((2, 2, 2)))
scipy.io.savemat(f"{folder}/columns.mat", columns)
scipy.io.savemat(f"{folder}/matrix.mat", {**places, "ch": outputs, "rate_hz": 1000.0, "told": "by hand"}, do_compression=True)
frame = pandas.DataFrame(columns)
frame.to_parquet(f"{folder}/pandas.parquet")
polars.DataFrame(columns).write_parquet(f"{folder}/polars.parquet", compression="snappy")
frame.to_parquet(f"{folder}/gzip.parquet", compression="gzip")
polars.DataFrame(columns).write_parquet(f"{folder}/zstd.parquet", compression="zstd")
