"""nidaqmx-python, used as its documentation does: a Task with three inputs, its names, three samples of each, and two errors."""

from ctypes.util import find_library

import nidaqmx
from nidaqmx.constants import AcquisitionType, TerminalConfiguration
from nidaqmx.errors import DaqError


def begun(task, physical):
    task.ai_channels.add_ai_voltage_chan(physical, terminal_config=TerminalConfiguration.RSE)
    task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=10_000)
    task.start()


def main():
    assert find_library("nidaqmx") == "libnidaqmx.so", find_library("nidaqmx")
    with nidaqmx.Task() as task:
        begun(task, "Dev1/ai2:4")
        assert task.channel_names == ["Dev1/ai2", "Dev1/ai3", "Dev1/ai4"], task.channel_names
        channels = task.read(number_of_samples_per_channel=3, timeout=5.0)
        task.stop()
    print([list(scan) for scan in zip(*channels)])
    for device in "Dev7", "Lost1":
        with nidaqmx.Task() as task:
            try:
                begun(task, f"{device}/ai0")
                task.read(timeout=5.0)
                raise AssertionError(f"{device} is in order")
            except DaqError as error:
                print(error)


main()
