"""Printrun's printcore drives the Marlin at a serial port: connects, streams numbered G-code, reads positions back."""

import os
import queue
import sys
import threading
import traceback

from printrun.printcore import printcore
from printrun import gcoder

PATIENCE_S = 30.0


def main(path):
    lines, online, ended = queue.Queue(), threading.Event(), threading.Event()
    printer = printcore()
    printer.onlinecb = online.set
    printer.endcb = ended.set
    printer.recvcb = lambda line: lines.put(line.strip())
    printer.connect(path, 115200)
    assert online.wait(PATIENCE_S), "it isn't online"

    def until(start):
        while True:
            line = lines.get(timeout=PATIENCE_S)
            if line.startswith(start):
                return line

    printer.send_now("M115")
    firmware = until("FIRMWARE_NAME:Marlin")
    # a job of numbered lines with checksums, more of them than the planner holds
    job = ["G21", "G90"] + [f"G1 X{0.1 * n:.1f} Y{-0.05 * n:.2f} F3000" for n in range(1, 41)] + ["M400"]
    assert printer.startprint(gcoder.LightGCode(job)), "it prints already"
    assert ended.wait(PATIENCE_S), "the job doesn't end"
    printer.send_now("M114")
    place = until("X:")
    assert place.startswith("X:4.00 Y:-2.00 Z:0.00") and "Count X:320 Y:-160 Z:0" in place, place
    # a motion of fewer than six steps is reported as made
    printer.send_now("G1 Z0.01 F60")
    printer.send_now("M400")
    printer.send_now("M114")
    place = until("X:")
    assert "Z:0.01" in place and place.endswith("Z:0"), place
    print(f"{firmware.split()[0]} {firmware.split()[1]}", flush=True)


try:
    main(sys.argv[1])
    code = 0
except BaseException:
    traceback.print_exc()
    code = 1
# its threads end only with the port in order
os._exit(code)
