#!/usr/bin/env python3
"""A stage for palpate: the process protocol of `palpate docs process`. Fill in the class Stage; the rest may stay as it is.

As it stands it is a stage in memory that moves in real time. Try it:  python3 examples/stage.py
    {"id": 1, "do": "identify"}
"""

import json
import queue
import signal
import sys
import threading
import time

SAME_PLACE_MM = 0.003  # an axis within this distance is where it is expected


class Stage:
    """Your device. A method that can't do what it is asked raises an exception: its text is what palpate tells.

    `stop` and `speed` are called from another thread, in the midst of the other methods too: hence the lock. `stopped` is set
    by then, and tells a method that it came too late."""

    identity = "stage in memory, serial number 0"

    def __init__(self):
        self.homed = False
        self.travel_mm = None  # until it is prepared
        self.speed_mm_s = 1.0
        self.position_mm = {"x": 0.0, "y": 0.0, "z": 0.0}
        self.target_mm = dict(self.position_mm)
        self.then_s = time.monotonic()
        self.lock = threading.RLock()
        self.stopped = threading.Event()

    def prepare(self, travel_mm, away, speed_mm_s, acceleration_mm_s2):
        """Comes to rest, finds home where it isn't known (z first, toward `away`: +1 or -1), takes travel_mm as its
        limits. Returns when all axes stand; a stop meanwhile ends the search."""
        self.stop()
        if not self.homed:
            for home_mm in {"z": away * 12.5}, {"x": 0.0, "y": 0.0}:
                self.go(home_mm, speed_mm_s)
                while self.status()[0] and not self.stopped.is_set():
                    time.sleep(0.01)
        with self.lock:
            if self.stopped.is_set():
                raise RuntimeError("stopped on the way home")
            self.homed = True
            self.travel_mm = travel_mm

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
        """Sends some axes on their way, unless a stop was faster."""
        with self.lock:
            if self.stopped.is_set():
                raise RuntimeError("stopped before it began")
            self.status()
            self.target_mm.update(to_mm)
            self.speed_mm_s = speed_mm_s

    def status(self):
        """Whether any axis moves, and where the axes are, mm, as read back."""
        with self.lock:
            now_s = time.monotonic()
            way_mm = self.speed_mm_s * (now_s - self.then_s)
            self.then_s = now_s
            for axis, target_mm in self.target_mm.items():
                left_mm = target_mm - self.position_mm[axis]
                step_mm = max(-way_mm, min(way_mm, left_mm))
                self.position_mm[axis] = target_mm if step_mm == left_mm else self.position_mm[axis] + step_mm
            return self.position_mm != self.target_mm, dict(self.position_mm)

    def speed(self, speed_mm_s):
        """Gives the motion under way another speed."""
        with self.lock:
            self.status()
            self.speed_mm_s = speed_mm_s

    def stop(self):
        """Brings all axes to rest at once."""
        with self.lock:
            self.status()
            self.target_mm = dict(self.position_mm)


def work(stage, request):
    do = request.get("do")
    if do == "identify":
        return {"role": "stage", "protocol": 2, "identity": stage.identity}
    if do == "prepare":
        keys = "travel_mm", "away", "speed_mm_s", "acceleration_mm_s2"
        stage.prepare(*(request[key] for key in keys))
        return {}
    if do == "move":
        stage.move(request["by_mm"], request.get("from_mm", {}), request["speed_mm_s"])
        return {}
    if do == "status":
        moving, position_mm = stage.status()
        return {"moving": moving, "position_mm": position_mm}
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
