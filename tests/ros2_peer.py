# SPDX-License-Identifier: Apache-2.0
"""A node with a service, an action, a parameter and three topics of different quality."""

import sys
import time

import rclpy
from calib_interfaces.action import Capture
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool


def answer(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
    response.success = request.data
    response.message = 'switched'
    return response


def capture(goal: ServerGoalHandle) -> Capture.Result:
    """Take a pose every 0.1 s, as many as asked for."""
    for taken in range(1, goal.request.poses_per_sphere + 1):
        time.sleep(0.1)
        if goal.is_cancel_requested:
            print('cancelled', flush=True)
            goal.canceled()
            return Capture.Result(message='cancelled')
        goal.publish_feedback(Capture.Feedback(taken=taken))
    goal.succeed()
    return Capture.Result(success=True, bag=goal.request.bag)


def main() -> None:
    rclpy.init()
    node = Node('peer')
    node.declare_parameter('rate', 5.0)
    ActionServer(
        node,
        Capture,
        'run',
        capture,
        callback_group=ReentrantCallbackGroup(),
        cancel_callback=lambda goal: CancelResponse.ACCEPT,
    )
    node.create_service(SetBool, 'switch', answer)
    latched = node.create_publisher(
        String, 'description', QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    )
    latched.publish(String(data='a' * 200))
    reliable = node.create_publisher(String, 'chatter', 10)
    sensor = node.create_publisher(JointState, 'joint_states', qos_profile_sensor_data)

    def publish() -> None:
        sensor.publish(JointState(name=['a1', 'a2'], position=[0.5, -1.0]))
        reliable.publish(String(data='hello'))

    node.create_timer(0.05, publish)
    print('ready', flush=True)
    try:
        rclpy.spin(node, executor=MultiThreadedExecutor())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    sys.exit(main())
