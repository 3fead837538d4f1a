"""Reads a lake: lake.py LIBRARY FOLDER counts the presses by sensor; lake.py queries FOLDER PAGE runs the queries of a page."""

import os
import re
import sys

library, folder = sys.argv[1:3]
os.chdir(folder)
if library == "duckdb":
    import duckdb

    rows = duckdb.sql("SELECT design, batch, sensor, count(*) FROM 'lake/presses/**/*.parquet' GROUP BY ALL").fetchall()
elif library == "polars":
    import polars

    rows = polars.scan_parquet("lake/presses/", hive_partitioning=True).group_by("design", "batch", "sensor").len().collect().rows()
elif library == "pyarrow":
    import pyarrow.dataset

    table = pyarrow.dataset.dataset("lake/presses", partitioning="hive").to_table(columns=["design", "batch", "sensor"])
    rows = [tuple(row.values()) for row in table.group_by(["design", "batch", "sensor"]).aggregate([([], "count_all")]).to_pylist()]
elif library == "queries":
    import duckdb

    with open(sys.argv[3]) as file:
        queries = re.findall(r"```sql\n(.*?)```", file.read(), re.DOTALL)
    for query in queries:
        found = duckdb.sql(query)
        rows = found.fetchall()
        print(len(rows), len([row for row in rows if None not in row]), " ".join(found.columns))
    sys.exit()
for row in sorted(rows, key=str):
    print(*row, sep="|")
