"""nidaqmx-python calls the library it finds: three scans of three inputs, and two errors.

Its Task asks the library much else (names, attributes) that the stub doesn't have: its interpreter, which has the
signatures, is called as Task calls it."""

import sys
from ctypes.util import find_library

import numpy
from nidaqmx._library_interpreter import LibraryInterpreter
from nidaqmx.errors import DaqError

RSE, VOLTS, RISING, CONTINUOUS, BY_SCAN = 10083, 10348, 10280, 10123, 1


def running(ni, physical):
    task, _ = ni.create_task("")
    ni.create_ai_voltage_chan(task, physical, "", RSE, -10.0, 10.0, VOLTS, None)
    ni.cfg_samp_clk_timing(task, 1000.0, "", RISING, CONTINUOUS, 10_000)
    ni.start_task(task)
    return task


def main():
    assert find_library("nidaqmx") == "libnidaqmx.so", find_library("nidaqmx")
    ni = LibraryInterpreter()
    task = running(ni, "Dev1/ai2:4")
    scans, read = ni.read_analog_f64(task, 3, 5.0, BY_SCAN, numpy.zeros((3, 3)))
    assert read == 3
    print(scans.tolist())
    ni.stop_task(task)
    ni.clear_task(task)
    for device in "Dev7", "Lost1":
        try:
            ni.read_analog_f64(running(ni, f"{device}/ai0"), 1, 5.0, BY_SCAN, numpy.zeros((1, 1)))
            raise AssertionError(f"{device} is in order")
        except DaqError as error:
            print(error)


main()
