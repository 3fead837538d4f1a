"""Time of a solve: one call compared with Rust's, and a batch compared with numpy, on one thread.

    cargo build --release --manifest-path python/Cargo.toml --example one_call
    python python/bench/solve.py python/target/release/examples/one_call

Without the program, only Python is measured. The method is the paper's (`pearson`) on 9 outputs and 625 places. Calls are paired:
Python and Rust are measured in turns, and the median of the differences counts. Of the batch the processor's time is measured,
which is the same on a busy machine.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import palpate

ROUNDS = 41
CALLS = 2000
BATCH = 20_000


def numpys_forms(places, force_n, outputs):
    """Ways to compute the paper's method with numpy: the place of the highest correlation, and the force of the loudest output."""
    rows = outputs - outputs.mean(axis=1, keepdims=True)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    loudest = np.abs(outputs).argmax(axis=1)
    loudness = force_n / outputs[np.arange(len(outputs)), loudest]

    def form(kind, chunk):
        table = np.ascontiguousarray(rows.T, dtype=kind)

        def solve(readings):
            best = np.empty(len(readings), dtype=np.intp)
            for start in range(0, len(readings), chunk):
                part = readings[start : start + chunk]
                # the length of the reading changes no order
                centred = (part - part.mean(axis=1, keepdims=True)).astype(kind)
                best[start : start + chunk] = (centred @ table).argmax(axis=1)
            force = readings[np.arange(len(readings)), loudest[best]] * loudness[best]
            return places[best], force

        return solve

    return {f"{np.dtype(kind).name}, {chunk} at once": form(kind, chunk) for kind in ("f8", "f4") for chunk in (64, 256, 1024, 20_000)}


def cpu_s(call):
    start = time.thread_time()
    call()
    return time.thread_time() - start


def main():
    folder = Path(tempfile.mkdtemp())
    run = palpate.simulate(out=folder / "run")
    model = palpate.fit(run, "pearson")
    model.save(folder / "pearson.palpate")
    grid = run.calibration_matrix
    places, outputs = np.column_stack([grid.x_mm, grid.y_mm]), grid.outputs
    random = np.random.default_rng(1)
    readings = outputs[random.integers(len(outputs), size=BATCH)] * random.uniform(0.3, 1.0, (BATCH, 1))
    readings += random.normal(0, 0.003, readings.shape)
    print(f"pearson, {outputs.shape[1]} outputs x {len(outputs)} places")

    forms = numpys_forms(places, grid.force_n, outputs)
    ours = model.solve(readings)
    agreed = max(np.mean(np.all(form(readings)[0] == np.column_stack([ours.x_mm, ours.y_mm]), axis=1)) for form in forms.values())
    times = {name: [] for name in ["palpate", *forms]}
    for _ in range(ROUNDS):
        times["palpate"].append(cpu_s(lambda: model.solve(readings)) / BATCH)
        for name, form in forms.items():
            times[name].append(cpu_s(lambda: form(readings)) / BATCH)
    medians = {name: np.median(spent) for name, spent in times.items()}
    for name, median in medians.items():
        print(f"batch of {BATCH}: {1e9 * median:7.0f} ns of the processor a solve, {name}")
    # palpate's answers are those of double precision
    for kind in ("float64", "float32"):
        best = min((name for name in forms if name.startswith(kind)), key=medians.get)
        ratio = np.median(np.array(times["palpate"]) / np.array(times[best]))
        print(f"palpate / numpy's best in {kind} ({best}): {ratio:.2f}")
    print(f"numpy finds the same place in {100 * agreed:.2f} % of the readings; it computes place and force alone")

    one = np.ascontiguousarray(readings[:CALLS])
    one.tofile(folder / "readings")
    rows = list(one)
    command = [*sys.argv[1:], folder / "pearson.palpate", folder / "readings"]
    pipe = subprocess.PIPE
    rust = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) if len(sys.argv) > 1 else None
    called, differences = [], []
    for _ in range(ROUNDS):
        spent = []
        for reading in rows:
            start = time.perf_counter_ns()
            model.solve(reading)
            spent.append(time.perf_counter_ns() - start)
        called.append(np.median(spent))
        if rust:
            rust.stdin.write("\n")
            rust.stdin.flush()
            differences.append(called[-1] - json.loads(rust.stdout.readline()))
    clock = np.median([-time.perf_counter_ns() + time.perf_counter_ns() for _ in range(10_000)])
    print(f"one call: median {np.median(called):.0f} ns, of which the clock {clock:.0f} ns")
    if rust:
        print(f"one call over Rust's: {np.median(differences):.0f} ns (medians, paired)")
        rust.stdin.close()
        rust.wait()


main()
