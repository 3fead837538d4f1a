"""ur_rtde's receive and dashboard interfaces read a robot: python3 ur_rtde.py HOST, with its usual ports."""

import sys
import time

from dashboard_client import DashboardClient
from rtde_receive import RTDEReceiveInterface

receive = RTDEReceiveInterface(sys.argv[1], 125.0)
dashboard = DashboardClient(sys.argv[1])
dashboard.connect()
first = receive.getTimestamp()
time.sleep(0.1)
assert receive.getTimestamp() > first, "the state isn't refreshed"
place = " ".join(f"{1000 * metres:.1f}" for metres in receive.getActualTCPPose()[:3])
modes = receive.getRobotMode(), receive.getSafetyMode(), receive.getRuntimeState()
assert modes == (7, 1, 1), modes
assert dashboard.robotmode() == "Robotmode: RUNNING" and dashboard.isInRemoteControl()
print(f"{dashboard.getRobotModel()} at {place} mm")
receive.disconnect()
dashboard.disconnect()
