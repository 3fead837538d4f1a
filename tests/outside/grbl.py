"""grbl-streamer drives the GRBL at a serial port: resets it, asks it for all it has, polls it, streams G-code."""

import os
import queue
import sys
import traceback

from grbl_streamer import GrblStreamer

PATIENCE_S = 20.0


def main(path):
    events = queue.Queue()
    grbl = GrblStreamer(lambda event, *data: events.put((event, data)))

    def until(event, fits=lambda *data: True):
        """What comes with the next event of a kind; an alarm or an error that isn't waited for is an end."""
        while True:
            told, data = events.get(timeout=PATIENCE_S)
            if told == event and fits(*data):
                return data
            assert told not in ("on_alarm", "on_error"), (told, data)

    # locked until it is homed; while it homes it answers nothing
    grbl.cnect(path, 115200)
    until("on_read", lambda line: line.startswith("Grbl 1.1"))
    until("on_boot")
    until("on_read", lambda line: line.startswith("$132="))
    grbl.poll_start()
    until("on_stateupdate", lambda mode, *_: mode == "Alarm")
    grbl.homing()
    until("on_stateupdate", lambda mode, *_: mode == "Idle")
    assert grbl.cmpos == (-0.5, -0.5, -0.5), grbl.cmpos  # pulled off its switches at 0 by $27

    # a job of short lines, more of them than the buffer holds, by counting characters
    job = ["G21 G90 G94 F1500"] + [f"G1 X{-5 + 0.1 * n:.1f} Y{-5 - 0.05 * n:.2f}" for n in range(1, 31)] + ["G4 P0.01"]
    grbl.incremental_streaming = False
    grbl.write(job)
    grbl.job_run()
    until("on_job_completed")
    until("on_stateupdate", lambda mode, place, _: mode == "Idle" and abs(place[0] + 2.0) < 1e-3)
    assert abs(grbl.cmpos[1] + 6.5) < 1e-3, grbl.cmpos

    # its answers to $# and $G, taken apart by the client
    grbl.send_immediately("G92 X1")
    grbl.hash_state_requested = True
    until("on_hash_stateupdate", lambda offsets: offsets["G92"] == (-3.0, 0.0, 0.0))
    grbl.gcode_parser_state_requested = True
    until("on_read", lambda line: line == "[GC:G1 G54 G17 G21 G90 G94 M5 M9 T0 F1500 S0]")

    # a jog that is cut short: x stops on its way, and its place is still known
    grbl.send_immediately("$J=G91 X-6 F300")
    until("on_stateupdate", lambda mode, *_: mode == "Jog")
    grbl._iface.serialport.write(b"\x85")
    until("on_stateupdate", lambda mode, *_: mode == "Idle")
    assert -8.0 < grbl.cmpos[0] < -2.0, grbl.cmpos

    # what it doesn't know is an error, what is beyond its travel an alarm
    grbl.send_immediately("G1 X1 Q0 H7")
    error = wanted(events, "on_error")
    assert error[0].startswith("error:"), error
    grbl.send_immediately("G0 X13")
    (alarm,) = wanted(events, "on_alarm")
    assert alarm == "ALARM:2", alarm
    print(f"x at {grbl.cmpos[0]:.3f} mm", flush=True)


def wanted(events, event):
    while True:
        told, data = events.get(timeout=PATIENCE_S)
        if told == event:
            return data


try:
    main(sys.argv[1])
    ended = 0
except BaseException:
    traceback.print_exc()
    ended = 1
# its threads end only with the port in order
os._exit(ended)
