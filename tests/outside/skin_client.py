"""The PyPI package of a magnetic skin reads the board at a serial port, and prints the mean of each channel."""

import importlib
import sys

FRAMES = 50


def main(package, port):
    module = importlib.import_module(f"{package}.sensor")
    base = getattr(module, "AnySkinBase" if package == "anyskin" else "ReSkinBase")
    skin = base(num_mags=5, port=port, temp_filtered=True)
    rows = []
    for sample in skin.get_data(FRAMES):
        # anyskin: time and numbers in one array; reskin-sensor: a tuple with its data
        rows.append(list(sample.data) if hasattr(sample, "dev_id") else list(sample[1:]))
    assert len(rows) == FRAMES and all(len(row) == 15 for row in rows), [len(row) for row in rows]
    means = [sum(column) / FRAMES for column in zip(*rows)]
    print("means", " ".join(f"{mean:.2f}" for mean in means), flush=True)


main(*sys.argv[1:])
