# SPDX-License-Identifier: Apache-2.0
"""A domain of one's own: with no graph on it, and with none of ours before it is let go."""

import os
import subprocess
import sys

import pytest

from calib_bringup import domains
from calib_bringup.domains import claimed_domain, held_domain
from calib_model.errors import CalibrationError

pytestmark = pytest.mark.system

NODE = """
import rclpy, sys
rclpy.init()
node = rclpy.create_node('somebody')
print('there', flush=True)
sys.stdin.read()
"""


def somebody(domain):
    node = subprocess.Popen(
        [sys.executable, '-c', NODE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={
            **os.environ,
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        },
    )
    assert node.stdout.readline() == 'there\n'
    return node


def test_what_is_claimed_is_nobody_else_s_until_it_is_let_go(monkeypatch):
    with claimed_domain() as domain:
        monkeypatch.setattr(domains, 'DOMAINS', [domain])
        with pytest.raises(CalibrationError, match='every ROS domain'), claimed_domain():
            pass
    with claimed_domain() as again:
        assert again == domain


def test_a_domain_is_not_free_while_any_of_its_nodes_lives(monkeypatch):
    domain = held_domain()
    first, second = somebody(domain), somebody(domain)
    monkeypatch.setattr(domains, 'CLAIM', 247)  # as if nobody had claimed it
    monkeypatch.setattr(domains, 'DOMAINS', [domain])
    for ended in (first, second):
        with pytest.raises(CalibrationError, match='every ROS domain'), claimed_domain():
            pass
        ended.communicate('', timeout=20)
    with claimed_domain() as free:
        assert free == domain
