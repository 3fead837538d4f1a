#!/usr/bin/env python3
"""A robot arm for palpate that finishes each motion: the process protocol of `palpate docs process`. Replace the class Arm.

In the rig:  driver = { process = ["python3", "examples/arm.py"], finishes = true }
"""

import json
import sys
import time


class Arm:
    """Your arm: straight motions of its tip with a fixed orientation, in a frame that you taught. Lengths are in mm.

    As it stands it is an arm in memory. It needs no stop: palpate sends only motions that are safe to finish."""

    identity = "arm in memory, serial number 0"

    def __init__(self):
        self.start_mm = self.end_mm = {"x": 0.0, "y": 0.0, "z": 10.0}
        self.begun_s, self.takes_s = time.monotonic(), 0.0

    def move(self, to_mm, speed_mm_s, acceleration_mm_s2):
        """Begins a straight motion to a place. `speed_mm_s` is that of the fastest axis."""
        self.start_mm, self.end_mm = self.place()[1], to_mm
        way_mm = max(abs(to_mm[axis] - self.start_mm[axis]) for axis in to_mm)
        self.begun_s, self.takes_s = time.monotonic(), way_mm / speed_mm_s + speed_mm_s / acceleration_mm_s2

    def place(self):
        """Whether the arm moves, and where its tip is, as measured."""
        share = 1.0 if self.takes_s == 0.0 else min(1.0, (time.monotonic() - self.begun_s) / self.takes_s)
        return share < 1.0, {axis: (1.0 - share) * self.start_mm[axis] + share * self.end_mm[axis] for axis in "xyz"}


def main():
    arm, travel_mm, acceleration_mm_s2 = Arm(), None, 100.0
    for line in sys.stdin:
        request, reply = json.loads(line), {}
        if request["do"] == "identify":
            reply = {"role": "stage", "protocol": 2, "identity": arm.identity}
        elif request["do"] == "prepare":  # nothing moves: an arm knows where it is
            travel_mm, acceleration_mm_s2 = request["travel_mm"], request["acceleration_mm_s2"]
        elif request["do"] == "move":
            # each axis goes by a distance, if it is where it is expected
            at_mm, by_mm = arm.place()[1], request["by_mm"]
            to_mm = {axis: round(at_mm[axis] + by_mm.get(axis, 0.0), 6) for axis in "xyz"}
            is_there = all(abs(at_mm[axis] - mm) < 0.003 for axis, mm in request.get("from_mm", {}).items())
            if is_there and travel_mm and all(travel_mm[axis][0] <= to_mm[axis] <= travel_mm[axis][1] for axis in by_mm):
                arm.move(to_mm, request["speed_mm_s"], acceleration_mm_s2)
            else:
                reply = {"error": f"not prepared, not where it is expected, or {to_mm} is outside the travel"}
        elif request["do"] == "status":
            moving, place_mm = arm.place()
            reply = {"moving": moving, "position_mm": place_mm, "homed": True}
        if "id" in request:  # `stop` and `speed` have none
            print(json.dumps({"id": request["id"], **reply}), flush=True)


main()
