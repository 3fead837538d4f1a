"""PyMeasure's ESP300 drives the ESP301 at a VISA resource, over a serial line or a socket."""

import sys

import pyvisa
from pymeasure.instruments.newport import ESP300


def near(value, expected):
    assert abs(value - expected) < 2e-3, (value, expected)


def main(resource):
    esp = ESP300(resource, visa_library="@py", read_termination="\r\n", write_termination="\r\n", timeout=5000)
    assert esp.ask("VE?").startswith("ESP301 Version 1.1"), "who is it?"
    for number, axis in enumerate((esp.x, esp.y, esp.phi), 1):
        assert axis.ask("ID?") == f"VP-25XL, SN{171800 + number}"
        assert axis.units == "millimeter"
        near(axis.position, 0.0)  # where it stood when it was switched on
    esp.clear_errors()

    # an axis whose motor is off complains, and stays
    esp.x.position = 1.0
    code, ticks, text = esp.ask("TB?").split(", ")
    assert (code, text) == ("113", "AXIS-1 MOTOR NOT ENABLED"), (code, text)
    assert int(ticks) >= 0 and esp.error == 0

    esp.x.enable()
    assert esp.x.enabled and not esp.errors
    esp.x.home()
    esp.x.wait_for_stop()
    near(esp.x.position, 0.0)
    esp.x.position = 1.5
    esp.x.wait_for_stop(delay=0.1)
    assert esp.x.motion_done
    near(esp.x.position, 1.5)
    esp.x.define_position(-3.25)
    near(esp.x.position, -3.25)
    esp.x.zero()
    near(esp.x.position, 0.0)
    esp.x.define_position(1.5)

    # soft limits, as set and as kept
    esp.x.left_limit, esp.x.right_limit = -2.0, 2.0
    near(esp.x.left_limit, -2.0)
    near(esp.x.right_limit, 2.0)
    esp.x.position = 2.5
    errors = [(error.axis, error.message) for error in esp.errors]
    assert errors == [("1", "POSITIVE SOFTWARE LIMIT DETECTED")], errors
    near(esp.x.position, 1.5)

    # units are a label, except for encoder counts
    esp.x.units = "encoder count"
    assert esp.x.units == "encoder count"
    counts = esp.x.position
    esp.x.units = "millimeter"
    assert counts > 1000, counts

    # two in the queue, the oldest first; what SCPI has isn't known, and isn't answered
    esp.write("4PA1")
    esp.write("1QQ")
    assert [str(error.error) for error in esp.errors] == ["9", "6"]
    esp.adapter.connection.timeout = 500
    for ask in (lambda: esp.complete), (lambda: esp.id), esp.shutdown:  # *OPC?, *IDN?, and *OPC? once more
        try:
            raise AssertionError(f"it answered {ask()!r}")
        except pyvisa.errors.VisaIOError as error:
            assert error.error_code == pyvisa.constants.StatusCode.error_timeout, error
    esp.adapter.connection.timeout = 5000
    assert [error.error for error in esp.errors] == ["6"] * 3

    esp.x.position = 0.25
    esp.x.wait_for_stop()
    print(f"x at {esp.x.position:.3f} mm")
    esp.x.disable()
    assert not esp.x.enabled
    esp.adapter.close()


main(sys.argv[1])
