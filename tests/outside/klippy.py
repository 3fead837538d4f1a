"""Moonraker in front of a socket that answers as Klipper's API server does, for a printer whose tip presses a spring.

    python3 klippy.py FOLDER

Prints Moonraker's address once it has found the printer. FOLDER/tip has the place of z (8 bytes, there before), FOLDER/peak the largest
force, N; printer_bench.py reads the first."""

import asyncio
import json
import mmap
import os
import runpy
import socket
import struct
import sys
import threading
import time
import urllib.request

FOLDER = sys.argv[1]
# the printer's z while the tip touches, the spring of printer_bench.py, and that bench's own surface
SURFACE_MM, SPRING_N_MM, BENCH_SURFACE_MM = 113.0, 1.3, 10.07
LATE_S, ETX = 0.25, b"\x03"
STEPPER = {"rotation_distance": 40.0, "microsteps": 16, "full_steps_per_rotation": 200, "position_min": 0.0, "position_max": 235.0}


class Printer:
    """Axes that move one after another, with constant speed."""

    def __init__(self):
        self.at = {"x": 0.0, "y": 0.0, "z": 0.0}
        self.homed, self.speed_mm_s, self.peak_n = "", 5.0, 0.0
        self.is_relative = False
        # where the tip is when Klipper doesn't know it yet: 5 mm over the spring
        self.offset_mm = None
        with open(os.path.join(FOLDER, "tip"), "r+b") as file:
            self.tip = mmap.mmap(file.fileno(), 8)
        self.show()

    def show(self):
        z_mm = SURFACE_MM + 5.0 if self.offset_mm is None else self.at["z"] + self.offset_mm
        force_n = SPRING_N_MM * max(0.0, SURFACE_MM - z_mm)
        self.tip[:8] = struct.pack("d", BENCH_SURFACE_MM + z_mm - SURFACE_MM)
        if force_n > self.peak_n:
            self.peak_n = force_n
            with open(os.path.join(FOLDER, "peak"), "w") as file:
                file.write(str(force_n))

    async def run(self, script):
        for line in script.split("\n"):
            words = line.split()
            values = {word[0].lower(): float(word[1:]) for word in words[1:] if words[0] in ("G0", "G1")}
            if words[0] == "SET_KINEMATIC_POSITION":
                for word in words[1:]:
                    name, value = word.split("=")
                    self.at[name.lower()] = float(value)
                self.homed, self.offset_mm = "xyz", SURFACE_MM + 5.0 - self.at["z"]
            elif words[0] in ("G90", "G91"):
                self.is_relative = words[0] == "G91"
            elif words[0] in ("G0", "G1"):
                if self.homed != "xyz":
                    raise ValueError("Must home axis first: {x:.3f} {y:.3f} {z:.3f} [0.000]".format(**self.at))
                self.speed_mm_s = values.pop("f", 60.0 * self.speed_mm_s) / 60.0
                if self.is_relative:
                    values = {axis: self.at[axis] + by_mm for axis, by_mm in values.items()}
                await asyncio.sleep(LATE_S)
                start, begun = dict(self.at), time.monotonic()
                way_mm = sum((values[axis] - start[axis]) ** 2 for axis in values) ** 0.5
                while way_mm > 0.0:
                    share = min(1.0, (time.monotonic() - begun) * self.speed_mm_s / way_mm)
                    self.at.update({axis: start[axis] + share * (values[axis] - start[axis]) for axis in values})
                    self.show()
                    if share == 1.0:
                        break
                    await asyncio.sleep(0.001)

    def status(self):
        place = [self.at[axis] for axis in "xyz"] + [0.0]
        return {
            "webhooks": {"state": "ready", "state_message": "Printer is ready"},
            "toolhead": {"position": place, "homed_axes": self.homed},
            "motion_report": {"live_position": place},
            "gcode_move": {"gcode_position": place, "absolute_coordinates": True, "speed_factor": 1.0},
            "configfile": {"settings": {
                "printer": {"max_velocity": 300.0, "max_accel": 3000.0, "max_z_velocity": 5.0, "max_z_accel": 100.0},
                "stepper_x": STEPPER, "stepper_y": STEPPER, "stepper_z": {**STEPPER, "rotation_distance": 8.0},
            }},
        }


async def serve(path):
    printer, lock = Printer(), asyncio.Lock()

    async def answer(request):
        method, params = request["method"], request.get("params", {})
        if method == "info":
            return {"state": "ready", "state_message": "Printer is ready", "hostname": "bench", "software_version": "v0.12.0",
                    "klipper_path": FOLDER, "python_path": sys.executable, "log_file": "", "config_file": "", "process_id": os.getpid()}
        if method == "list_endpoints":
            return {"endpoints": ["info", "objects/list", "objects/query", "objects/subscribe", "gcode/script", "gcode/help", "emergency_stop"]}
        if method == "objects/list":
            return {"objects": list(printer.status())}
        if method in ("objects/query", "objects/subscribe"):
            known = printer.status()
            pick = lambda name, keys: {key: known[name][key] for key in (keys or known[name]) if key in known[name]}
            return {"eventtime": time.monotonic(), "status": {name: pick(name, keys) for name, keys in params["objects"].items() if name in known}}
        if method == "gcode/script":
            async with lock:
                await printer.run(params["script"])
        return {}

    async def client(reader, writer):
        async def reply(request):
            try:
                text = {"id": request["id"], "result": await answer(request)}
            except Exception as error:
                text = {"id": request["id"], "error": {"error": "WebRequestError", "message": str(error)}}
            writer.write(json.dumps(text).encode() + ETX)

        while True:
            request = json.loads((await reader.readuntil(ETX))[:-1])
            if "id" in request:
                asyncio.ensure_future(reply(request))

    server = await asyncio.start_unix_server(client, path)
    async with server:
        await server.serve_forever()


def announce(port):
    """Prints the address when the printer is ready."""
    while True:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/server/info") as answer:
                if json.load(answer)["result"]["klippy_state"] == "ready":
                    print(f"printer at 127.0.0.1:{port}", flush=True)
                    return
        except OSError:
            pass
        time.sleep(0.1)


with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
uds = os.path.join(FOLDER, "klippy.sock")
config = os.path.join(FOLDER, "moonraker.conf")
with open(config, "w") as file:
    file.write(f"[server]\nhost: 127.0.0.1\nport: {port}\nklippy_uds_address: {uds}\n[authorization]\ntrusted_clients:\n  127.0.0.1\n")
threading.Thread(target=lambda: asyncio.run(serve(uds)), daemon=True).start()
threading.Thread(target=announce, args=(port,), daemon=True).start()
sys.argv = ["moonraker", "-d", os.path.join(FOLDER, "data"), "-c", config, "-u", os.path.join(FOLDER, "m.sock"), "-n"]
runpy.run_module("moonraker", run_name="__main__")
