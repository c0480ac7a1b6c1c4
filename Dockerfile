# SPDX-License-Identifier: Apache-2.0
# The suite on a full ROS 2 Jazzy. UNTRIED: written after the documentation of ros:jazzy, never built.
# Without Docker `make demo` brings all it needs; that is what the tests try.
FROM ros:jazzy

SHELL ["/bin/bash", "-c"]
WORKDIR /suite/ros2_ws
COPY ros2_ws/src src

# EAIK has no rosdep key; threadpoolctl has none either and is used where numpy came first.
RUN apt-get update \
    && apt-get install -y --no-install-recommends python3-pip \
    && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src --ignore-src -y --rosdistro jazzy \
    && pip install --break-system-packages --no-deps EAIK threadpoolctl \
    && rm -rf /var/lib/apt/lists/*

RUN source /opt/ros/jazzy/setup.bash && colcon build

ENTRYPOINT ["/bin/bash", "-c", "source /opt/ros/jazzy/setup.bash && source install/setup.bash && exec \"$@\"", "--"]
CMD ["ros2", "run", "calib_bringup", "demo"]
