"""A node for ROS 2: outputs of the array in, contacts out.

    python3 ros2_contact.py --ros-args -p model:=sensor.palpate -p frame_id:=fingertip

Subscribes to `outputs` (std_msgs/Float32MultiArray: one reading minus that without load, in the unit of the calibration) and publishes
`contact` (geometry_msgs/PointStamped, in m) and `force` (geometry_msgs/WrenchStamped, in N, along -z of the frame) for credible
contacts. The tests run it against a stand-in of rclpy; it has not run in ROS itself.
"""

import palpate
import rclpy
from geometry_msgs.msg import PointStamped, WrenchStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import Float32MultiArray


class Contacts(Node):
    def __init__(self):
        super().__init__("palpate_contacts")
        self.frame_id = self.declare_parameter("frame_id", "sensor").value
        self.session = palpate.Model.load(self.declare_parameter("model", "sensor.palpate").value).session()
        self.contact = self.create_publisher(PointStamped, "contact", 10)
        self.force = self.create_publisher(WrenchStamped, "force", 10)
        self.create_subscription(Float32MultiArray, "outputs", self.solve, 10)

    def solve(self, outputs):
        solved = self.session.solve(outputs.data)
        if solved.verdict != "ok":
            return
        point, wrench = PointStamped(), WrenchStamped()
        for message in (point, wrench):
            message.header.stamp = self.get_clock().now().to_msg()
            message.header.frame_id = self.frame_id
        point.point.x, point.point.y = solved.x_mm / 1000, solved.y_mm / 1000
        wrench.wrench.force.z = -solved.force_n
        self.contact.publish(point)
        self.force.publish(wrench)


def main():
    rclpy.init()
    try:
        rclpy.spin(Contacts())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
