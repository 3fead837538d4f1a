#!/usr/bin/env python3
"""An array for palpate: the process protocol of `palpate docs process`. Fill in the class Array; the rest may stay as it is.

As it stands it is an array in memory that feels nothing but noise. Try it:  python3 examples/array.py 9
    {"id": 1, "do": "identify"}
    {"id": 2, "do": "read"}
"""

import json
import random
import signal
import sys


class Array:
    """Your device. A method that can't do what it is asked raises an exception: its text is what palpate tells."""

    identity = "array in memory, serial number 0"

    def __init__(self, units):
        self.units = units

    def read(self):
        """One number a unit, V, in the order of the rig's grid (row by row) or its places_mm."""
        return [random.gauss(0.0, 0.001) for _ in range(self.units)]

    def close(self):
        """palpate is done."""


def work(array, request):
    do = request.get("do")
    if do == "identify":
        return {"role": "array", "protocol": 1, "identity": array.identity, "units": array.units}
    if do == "read":
        return {"outputs": array.read()}
    raise ValueError(f"unknown request {do!r}")


def main():
    # Ctrl-C is palpate's to act on: it closes the standard input when all is at rest
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    array = Array(units=int(sys.argv[1]) if len(sys.argv) > 1 else 9)
    for line in sys.stdin:
        request = json.loads(line)
        try:
            reply = work(array, request)
        except Exception as error:
            reply = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps({"id": request["id"], **reply}), flush=True)
    array.close()


if __name__ == "__main__":
    main()
