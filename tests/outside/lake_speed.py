"""CPU of DuckDB, s: the maps of all sensors, and those of one. lake_speed.py FOLDER."""

import os
import resource
import sys

import duckdb

os.chdir(sys.argv[1])


def cpu():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


MAPS = "SELECT sensor, x_mm, y_mm, " + ", ".join(f"avg(out_{n})" for n in range(1, 10)) + " FROM '{}' {} GROUP BY ALL"
duckdb.sql("SELECT 1").fetchall()
took = []
for files, where in [
    ("lake/presses/**/*.parquet", ""),
    ("lake/presses/**/*.parquet", "WHERE sensor = 'S7'"),
    ("lake/presses/*/*/sensor=S7/*.parquet", ""),
]:
    began = cpu()
    rows = len(duckdb.sql(MAPS.format(files, where)).fetchall())
    took.append(cpu() - began)
    print(f"{took[-1]:.4f}", end=" ")
print("s of the CPU: all, one of all, one by its path;", rows, "rows")
