# SPDX-License-Identifier: Apache-2.0
"""A node with one service and three topics of different quality, for the ros2 commands to meet."""

import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool


def answer(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
    response.success = request.data
    response.message = 'switched'
    return response


def main() -> None:
    rclpy.init()
    node = Node('peer')
    node.create_service(SetBool, 'switch', answer)
    latched = node.create_publisher(
        String, 'description', QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    latched.publish(String(data='a' * 200))
    reliable = node.create_publisher(String, 'chatter', 10)
    sensor = node.create_publisher(JointState, 'joint_states', qos_profile_sensor_data)

    def publish() -> None:
        sensor.publish(JointState(name=['a1', 'a2'], position=[0.5, -1.0]))
        reliable.publish(String(data='hello'))

    node.create_timer(0.05, publish)
    print('ready', flush=True)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    sys.exit(main())
