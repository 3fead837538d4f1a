#!/usr/bin/env python3
"""A load cell for palpate: the process protocol of `palpate docs process`. Fill in the class LoadCell; the rest may stay as it is.

As it stands it is a cell in memory that bears nothing but noise. Try it:  python3 examples/load_cell.py
    {"id": 1, "do": "identify"}
    {"id": 2, "do": "read"}
"""

import json
import random
import signal
import sys


class LoadCell:
    """Your device. A method that can't do what it is asked raises an exception: its text is what palpate tells."""

    identity = "load cell in memory, serial number 0"

    def read(self):
        """The newest reading: force_n, N, pressing positive. Add "saturated": True where the force is beyond the range,
        "fault": True where the cell is broken."""
        return {"force_n": random.gauss(0.0, 0.001)}

    def close(self):
        """palpate is done."""


def work(cell, request):
    do = request.get("do")
    if do == "identify":
        return {"role": "load_cell", "protocol": 1, "identity": cell.identity}
    if do == "read":
        return cell.read()
    raise ValueError(f"unknown request {do!r}")


def main():
    # Ctrl-C is palpate's to act on: it closes the standard input when all is at rest
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cell = LoadCell()
    for line in sys.stdin:
        request = json.loads(line)
        try:
            reply = work(cell, request)
        except Exception as error:
            reply = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps({"id": request["id"], **reply}), flush=True)
    cell.close()


if __name__ == "__main__":
    main()
