#!/usr/bin/env python3
"""A printer as a stage for palpate: the process protocol of `palpate docs process`. Replace the class Printer; the rest may stay as it is.

As it stands it is a printer in memory that moves in real time. Try it:  python3 stage.py
    {"id": 1, "do": "identify"}

Your printer's firmware must report where the axes are while they move, and must stop a motion at once without losing its
position. Klipper reports the position (`motion_report` of its API server, docs/Status_Reference.md), but
begins a motion 0.25 s after the command and has no way to end one early but `emergency_stop`, which loses the position
(klippy/toolhead.py, BUFFER_TIME_START). palpate has drivers for GRBL and Marlin.
"""

import json
import math
import queue
import signal
import sys
import threading
import time

AXES = "x", "y", "z"
SAME_PLACE_MM = 0.01  # an axis within this distance is where it is expected: half a step, and 3 um


class Printer:
    """YOUR PRINTER: replace this class by one that sends the commands of your printer. Only this class knows the device.

    A method that can't do what it is asked raises an exception: its text is what palpate shows. Every method returns at once.
    Only one runs at a time."""

    identity = "printer in memory, serial number 0"
    step_mm = {"x": 0.0125, "y": 0.0125, "z": 0.0025}
    ends_mm = {"x": (0.0, 220.0), "y": (0.0, 220.0), "z": (0.0, 30.0)}  # low, so that its search is short

    def __init__(self):
        self.homed = False
        self.acceleration_mm_s2 = 100.0
        self.speed_mm_s = 1.0
        self.position_mm = {"x": 18.0, "y": 18.0, "z": 24.0}
        self.target_mm = dict(self.position_mm)
        self.velocity_mm_s = dict.fromkeys(AXES, 0.0)
        self.braking = False
        self.then_s = time.monotonic()

    def is_homed(self):
        """Whether the printer knows its position. A printer whose host runs on remembers it from program to program."""
        return self.homed

    def seek(self, directions, speed_mm_s):
        """Starts a search for the switches of some axes, each in a direction (+1 or -1)."""
        self.start({axis: self.ends_mm[axis][direction > 0] for axis, direction in directions.items()}, speed_mm_s)

    def set_homed(self):
        """The searches have ended."""
        self.homed = True

    def start(self, to_mm, speed_mm_s):
        """Starts a motion of some axes; the others aren't affected. The fastest moves at this speed."""
        self.run()
        self.braking = False
        self.speed_mm_s = speed_mm_s
        for axis, mm in to_mm.items():
            self.target_mm[axis] = round(mm / self.step_mm[axis]) * self.step_mm[axis]

    def change_speed(self, speed_mm_s):
        """Changes the speed of the motion, or does nothing if the printer can't."""
        self.run()
        self.speed_mm_s = speed_mm_s

    def brake(self):
        """Brings all axes to rest as fast as `acceleration_mm_s2` allows. The position stays known."""
        self.run()
        self.braking = True

    def where(self):
        """Whether any axis moves, and where the axes are now, mm: the steps that were sent, not the target."""
        self.run()
        place_mm = {axis: round(self.position_mm[axis] / self.step_mm[axis]) * self.step_mm[axis] for axis in AXES}
        return any(self.velocity_mm_s.values()) or self.position_mm != self.target_mm, place_mm

    def run(self):
        """Moves the printer in memory up to now. Yours moves by itself."""
        now_s = time.monotonic()
        while self.then_s < now_s:
            tick_s = min(0.001, now_s - self.then_s)
            self.then_s += tick_s
            for axis in AXES:
                self.tick(axis, tick_s)

    def tick(self, axis, tick_s):
        left_mm, velocity = self.target_mm[axis] - self.position_mm[axis], self.velocity_mm_s[axis]
        change = self.acceleration_mm_s2 * tick_s
        if self.braking:
            wanted = 0.0
        else:  # no faster than it can brake
            wanted = math.copysign(min(self.speed_mm_s, math.sqrt(2 * self.acceleration_mm_s2 * abs(left_mm))), left_mm)
        velocity += max(-change, min(change, wanted - velocity))
        way_mm = velocity * tick_s
        if self.braking and velocity == 0.0:
            self.position_mm[axis] = round(self.position_mm[axis] / self.step_mm[axis]) * self.step_mm[axis]
            self.target_mm[axis] = self.position_mm[axis]
        elif abs(left_mm) <= abs(way_mm) + 1e-6 and abs(velocity) <= 2 * change:
            self.position_mm[axis], velocity = self.target_mm[axis], 0.0
        else:
            self.position_mm[axis] += way_mm
        self.velocity_mm_s[axis] = velocity


class Stage:
    """The requests of the protocol. `stop` and `speed` are called from another thread, during the other methods too."""

    def __init__(self):
        self.printer = Printer()
        self.travel_mm = None  # until it is prepared
        self.lock = threading.RLock()
        self.stopped = threading.Event()

    def prepare(self, travel_mm, away, speed_mm_s, acceleration_mm_s2, home_speed_mm_s, home_side="away"):
        """Comes to rest, finds home if it isn't known (z first), takes travel_mm as its limits. Returns when all axes rest."""
        self.stop()
        self.wait()
        for axis, (low_mm, high_mm) in travel_mm.items():
            ends_mm = self.printer.ends_mm[axis]
            if not ends_mm[0] <= low_mm < high_mm <= ends_mm[1]:
                raise ValueError(f"{axis} can't travel from {low_mm} to {high_mm} mm")
        self.printer.acceleration_mm_s2 = acceleration_mm_s2
        if not self.printer.is_homed():
            if home_side == "none":
                raise RuntimeError("home isn't known, and the request forbids a search for it")
            # z first: x and y move only after nothing can touch
            self.seek({"z": -away if home_side == "toward" else away}, home_speed_mm_s)
            self.seek({"x": -1, "y": -1}, speed_mm_s)
            self.printer.set_homed()
        with self.lock:
            moving, at_mm = self.printer.where()
        inside = {axis: min(max(at_mm[axis], travel_mm[axis][0]), travel_mm[axis][1]) for axis in AXES}
        self.go({"z": inside["z"]}, home_speed_mm_s)
        self.wait()
        self.go({"x": inside["x"], "y": inside["y"]}, speed_mm_s)
        self.wait()
        self.travel_mm = travel_mm

    def seek(self, directions, speed_mm_s):
        with self.lock:
            self.refuse_if_stopped()
            self.printer.seek(directions, speed_mm_s)
        self.wait()

    def wait(self):
        while self.status()[0] and not self.stopped.is_set():
            time.sleep(0.005)
        self.refuse_if_stopped()

    def refuse_if_stopped(self):
        if self.stopped.is_set():
            raise RuntimeError("stopped before it was done")

    def move(self, by_mm, from_mm, speed_mm_s):
        """Begins a motion of the axes that are named, and returns while they move. Each goes by a distance, if it is where it is
        expected. Without `from_mm` it is the way out of a contact, from anywhere."""
        if self.travel_mm is None:
            raise RuntimeError("not prepared")
        at_mm = self.status()[1]
        for axis, expected_mm in from_mm.items():
            if abs(at_mm[axis] - expected_mm) > SAME_PLACE_MM:
                raise ValueError(f"{axis} is at {at_mm[axis]} mm, not at {expected_mm} mm")
        to_mm = {axis: round(at_mm[axis] + way_mm, 6) for axis, way_mm in by_mm.items()}
        for axis, place_mm in to_mm.items():
            low_mm, high_mm = self.travel_mm[axis]
            if not low_mm <= place_mm <= high_mm:
                raise ValueError(f"{axis} = {place_mm} mm is beyond the travel")
        self.go(to_mm, speed_mm_s)

    def go(self, to_mm, speed_mm_s):
        with self.lock:
            self.refuse_if_stopped()
            self.printer.start(to_mm, speed_mm_s)

    def status(self):
        with self.lock:
            return self.printer.where()

    def speed(self, speed_mm_s):
        with self.lock:
            self.printer.change_speed(speed_mm_s)

    def stop(self):
        with self.lock:
            self.printer.brake()


def work(stage, request):
    do = request.get("do")
    if do == "identify":
        return {"role": "stage", "protocol": 2, "identity": stage.printer.identity}
    if do == "prepare":
        keys = "travel_mm", "away", "speed_mm_s", "acceleration_mm_s2", "home_speed_mm_s"
        stage.prepare(*(request[key] for key in keys), request.get("home_side", "away"))
        return {}
    if do == "move":
        stage.move(request["by_mm"], request.get("from_mm", {}), request["speed_mm_s"])
        return {}
    if do == "status":
        moving, position_mm = stage.status()
        return {"moving": moving, "position_mm": position_mm, "homed": stage.printer.is_homed()}
    raise ValueError(f"unknown request {do!r}")


def listen(stage, requests):
    """Reads requests, and does at once what can't wait for the one before it."""
    for line in sys.stdin:
        request = json.loads(line)
        do = request.get("do")
        if do == "stop":
            stage.stopped.set()
            stage.stop()
        elif do == "speed":
            stage.speed(request["speed_mm_s"])
        else:
            stage.stopped.clear()
            requests.put(request)
    # palpate is done
    stage.stopped.set()
    requests.put(None)


def main():
    # Ctrl-C is palpate's to act on: it closes the standard input when all is at rest
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stage, requests = Stage(), queue.Queue()
    threading.Thread(target=listen, args=(stage, requests), daemon=True).start()
    for request in iter(requests.get, None):
        try:
            reply = work(stage, request)
        except Exception as error:
            reply = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps({"id": request["id"], **reply}), flush=True)
    stage.stop()


if __name__ == "__main__":
    main()
