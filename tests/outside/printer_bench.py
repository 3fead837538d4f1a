"""A bench around examples/printer.py: that stage, and a load cell and an array on a spring that its tip presses.

    python3 printer_bench.py FOLDER ROLE

The stage writes its true position to FOLDER/tip (8 bytes, there before) a thousand times a second; the load cell computes the force
of a spring from it. FOLDER/peak has the largest true force, N."""

import json
import mmap
import os
import random
import struct
import sys
import threading
import time

FOLDER, ROLE = sys.argv[1], sys.argv[2]
SURFACE_MM, SPRING_N_MM, NOISE_N = 10.07, 1.3, 0.003
TIP, PEAK = os.path.join(FOLDER, "tip"), os.path.join(FOLDER, "peak")


def play_stage():
    sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../examples"))
    import printer

    original, peak_n = printer.Stage, 0.0
    with open(TIP, "r+b") as file:
        tip = mmap.mmap(file.fileno(), 8)

    class Watched(original):
        def __init__(self):
            super().__init__()
            threading.Thread(target=self.publish, daemon=True).start()

        def publish(self):
            nonlocal peak_n
            while True:
                with self.lock:
                    self.printer.run()
                    z_mm = self.printer.position_mm["z"]
                tip[:8] = struct.pack("d", z_mm)
                force_n = SPRING_N_MM * max(0.0, SURFACE_MM - z_mm)
                if force_n > peak_n:
                    peak_n = force_n
                    with open(PEAK, "w") as file:
                        file.write(str(peak_n))
                time.sleep(0.001)

    printer.Stage = Watched
    printer.main()


def play_reader():
    with open(TIP, "r+b") as file:
        tip = mmap.mmap(file.fileno(), 8)
    noise = random.Random(7)
    for line in sys.stdin:
        request = json.loads(line)
        force_n = SPRING_N_MM * max(0.0, SURFACE_MM - struct.unpack("d", tip[:8])[0])
        if request["do"] == "identify":
            reply = {"role": ROLE, "protocol": 1, "identity": f"{ROLE} on a spring", "units": 9}
        elif ROLE == "load_cell":
            reply = {"force_n": force_n + noise.gauss(0.0, NOISE_N)}
        else:
            reply = {"outputs": [force_n * (1 + unit) / 10 + noise.gauss(0.0, 0.001) for unit in range(9)]}
        print(json.dumps({"id": request["id"], **reply}), flush=True)


play_stage() if ROLE == "stage" else play_reader()
