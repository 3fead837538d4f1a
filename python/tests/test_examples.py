"""The examples run."""

import importlib.util
import subprocess
import sys
import types

import palpate
import pytest
from conftest import EXAMPLE, ROOT

EXAMPLES = ROOT / "python" / "examples"


def test_the_first_example_plots_ten_thousand_contacts(tmp_path):
    picture = tmp_path / "contacts.png"
    command = [sys.executable, EXAMPLES / "first.py", EXAMPLE / "calibration.csv", picture]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert ": 10000 contacts, median location error 0." in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")


class Message:
    """A message of ROS: fields appear as they are used."""

    def __getattr__(self, name):
        self.__dict__[name] = Message()
        return self.__dict__[name]


class Node:
    """Stands in for rclpy.node.Node: keeps what is published, and calls the subscription when the test does."""

    parameters = {}

    def __init__(self, name):
        self.name, self.published, self.heard = name, [], {}

    def declare_parameter(self, name, default):
        return types.SimpleNamespace(value=self.parameters.get(name, default))

    def create_publisher(self, kind, topic, depth):
        return types.SimpleNamespace(publish=lambda message: self.published.append((topic, message)))

    def create_subscription(self, kind, topic, heard, depth):
        self.heard[topic] = heard

    def get_clock(self):
        return types.SimpleNamespace(now=lambda: types.SimpleNamespace(to_msg=lambda: "now"))


@pytest.fixture
def ros(monkeypatch):
    """A stand-in for ROS 2: its modules, as far as the example imports them."""

    def module(name, **contents):
        made = types.ModuleType(name)
        made.__dict__.update(contents)
        monkeypatch.setitem(sys.modules, name, made)

    spun = []
    module("rclpy", init=lambda: None, spin=spun.append, try_shutdown=lambda: spun.append("shut down"))
    module("rclpy.node", Node=Node)
    module("rclpy.executors", ExternalShutdownException=type("ExternalShutdownException", (Exception,), {}))
    for package, names in [("geometry_msgs", ["PointStamped", "WrenchStamped"]), ("std_msgs", ["Float32MultiArray"])]:
        module(package)
        module(package + ".msg", **{name: type(name, (Message,), {}) for name in names})
    return spun


def test_the_node_publishes_credible_contacts_in_si_units(ros, table, tmp_path, monkeypatch):
    model = palpate.fit(table, "surrogate")
    model.save(tmp_path / "a.palpate")
    monkeypatch.setattr(Node, "parameters", {"model": str(tmp_path / "a.palpate"), "frame_id": "fingertip"})
    spec = importlib.util.spec_from_file_location("ros2_contact", EXAMPLES / "ros2_contact.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    example.main()
    node, shut_down = ros
    assert shut_down == "shut down"
    reading = table.presses.outputs[30].astype("float32")
    node.heard["outputs"](types.SimpleNamespace(data=reading.tolist()))
    (topic, point), (other, wrench) = node.published
    expected = model.solve(reading)
    assert (topic, other) == ("contact", "force") and point.header.frame_id == wrench.header.frame_id == "fingertip"
    assert point.header.stamp == "now"
    assert (point.point.x, point.point.y) == (expected.x_mm / 1000, expected.y_mm / 1000)
    assert wrench.wrench.force.z == -expected.force_n < 0
    node.heard["outputs"](types.SimpleNamespace(data=[0.0] * 9))
    assert len(node.published) == 2, "no contact, nothing is published"
