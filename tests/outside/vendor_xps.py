"""Newport's own driver for Python, as pymodaq_plugins_newport carries it, on the XPS at an address.

Its folder alone is used: the package around it needs a whole desktop program."""

import importlib.util
import sys

sys.path[:0] = importlib.util.find_spec("pymodaq_plugins_newport").submodule_search_locations
from hardware.xps_q8_simplified import SimpleXPS, XPSError  # noqa: E402


def main(host, port):
    x = SimpleXPS(host, int(port), "XYZ", "X")  # kills, initialises and homes the group
    assert abs(x.get_position()) < 1e-3, x.get_position()
    x.move_absolute(1.5)
    x.move_relative(-0.25)
    assert abs(x.get_position() - 1.25) < 1e-3, x.get_position()
    try:
        x.move_absolute(13.0)
        raise AssertionError("it moved beyond its travel")
    except XPSError as error:
        assert "Parameter out of range" in str(error), error
    socket = x.socket_id
    assert x.xps.GroupStatusGet(socket, "XYZ") == [0, 12]
    assert x.xps.GroupStatusStringGet(socket, 12)[0] == 0
    assert x.xps.GroupPositionCurrentGet(socket, "XYZ", 3)[0] == 0
    assert x.xps.PositionerUserTravelLimitsGet(socket, "XYZ.Z") == [0, -12.5, 12.5]
    error, listed = x.xps.ErrorListGet(socket)
    assert error == 0 and "-27" in listed, listed
    error, volts = x.xps.GPIOAnalogGet(socket, ["GPIO2.ADC1"])
    assert error == 0 and abs(volts) < 0.1, (error, volts)
    print(f"x at {x.get_position():.3f} mm")
    x.close_tcpip()


main(*sys.argv[1:])
