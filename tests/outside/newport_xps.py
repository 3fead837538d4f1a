"""newportxps drives the XPS at an address: group XYZ of X, Y and Z.

It reads the names of groups and stages over FTP, from the controller's system.ini. That file is given to it here; all
else, the motion and its errors, goes through the controller's own port."""

import sys
import threading

import newportxps.newportxps
from newportxps import NewportXPS
from newportxps.XPS_C8_drivers import XPSException

STAGES = "".join(f"[XYZ.{name}]\nPlugNumber = {plug}\nStageName = VP-25XL\n" for plug, name in enumerate("XYZ", 1))
SYSTEM_INI = f"[GENERAL]\n[GROUPS]\nXYZInUse = XYZ\n[XYZ]\nPositionerInUse = X,Y,Z\n{STAGES}"


class Files:
    """Stands for the controller's FTP server."""

    def __init__(self, **_):
        pass

    def connect(self, **_):
        pass

    cwd = close = lambda *_: None

    def getlines(self, name):
        assert name == "system.ini", name
        return SYSTEM_INI.split("\n")


def main(host, port):
    newportxps.newportxps.FTPWrapper = Files
    xps = NewportXPS(host, port=int(port))
    assert xps.firmware_version.startswith("XPS-Q8"), xps.firmware_version
    assert xps.stages["XYZ.Z"] == {
        "stagetype": "VP-25XL", "max_velo": 25.0, "max_accel": 75.0, "low_limit": -12.5, "high_limit": 12.5,
    }, xps.stages
    assert xps._xps.errorcodes["-27"] and xps._xps.errorcodes["-17"]
    assert "Not initialized" in xps.get_group_status()["XYZ"]

    try:
        xps.move_stage("XYZ.X", 1.0)
        raise AssertionError("a group that isn't ready moved")
    except XPSException as error:
        assert "[Error -22]" in str(error), error
    xps.initialize_group("XYZ")
    assert "Not referenced" in xps.get_group_status()["XYZ"]
    xps.home_group("XYZ")
    assert "from homing" in xps.get_group_status()["XYZ"]

    # stages, one by one and together
    xps.set_velocity("XYZ.X", 20.0, 90.0)
    assert xps._xps.PositionerSGammaParametersGet(xps._sid, "XYZ.X")[1:3] == [20.0, 90.0]
    xps.move_stage("XYZ.X", 1.25)
    xps.move_stage("XYZ.X", -0.5, relative=True)
    assert abs(xps.get_stage_position("XYZ.X") - 0.75) < 1e-3
    xps.move_group("XYZ", y=-2.0, z=1.0)
    places = xps._xps.GroupPositionCurrentGet(xps._sid, "XYZ", 3)
    assert places[0] == 0 and all(abs(a - b) < 1e-3 for a, b in zip(places[1:], (0.75, -2.0, 1.0))), places
    try:
        xps.move_stage("XYZ.X", 13.0)
        raise AssertionError("it moved beyond its travel")
    except XPSException as error:
        assert "[Error -17]" in str(error), error
    assert "from motion" in xps.get_group_status()["XYZ"]

    # one connection waits for its move, another aborts it
    other = NewportXPS(host, port=int(port))
    ended = []
    wait = threading.Thread(target=lambda: ended.append(xps._xps.GroupMoveAbsolute(xps._sid, "XYZ.Y", [10.0])))
    wait.start()
    while "Moving" not in other.get_group_status()["XYZ"]:
        assert wait.is_alive(), ended
    other.abort_group("XYZ")
    wait.join()
    assert ended[0][0] == -27, ended
    assert "AbortMove" in other.get_group_status()["XYZ"]
    y_mm = other.get_stage_position("XYZ.Y")
    assert -2.0 <= y_mm < 10.0, y_mm

    # the load cell's amplifier, in air
    error, volts = other._xps.GPIOAnalogGet(other._sid, ["GPIO2.ADC1"])
    assert error == 0 and abs(volts) < 0.1, (error, volts)
    report = other.status_report()
    assert "XYZ.Z (VP-25XL)" in report and "Positioner Errors: OK" in report, report

    xps.disable_group("XYZ")
    assert "Disable" in xps.get_group_status()["XYZ"]
    xps.enable_group("XYZ")
    xps.kill_group("XYZ")
    assert "GroupKill" in xps.get_group_status()["XYZ"]
    print(f"y stopped at {y_mm:.3f} mm")


main(*sys.argv[1:])
