# SPDX-License-Identifier: Apache-2.0
"""The type and the quality of service that connect to what a topic's publishers offer."""

import argparse
from typing import Any

from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    QoSPresetProfiles,
    QoSProfile,
    ReliabilityPolicy,
)

from .command_line import Refusal
from .interfaces import interface
from .nearest import nearest


def add_qos_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--qos-profile',
        default='sensor_data',
        choices=QoSPresetProfiles.short_keys(),
        help='Quality of service preset profile to subscribe with',
    )
    parser.add_argument('--qos-depth', metavar='N', type=int, help='Queue size setting')
    parser.add_argument(
        '--qos-reliability',
        choices=ReliabilityPolicy.short_keys(),
        help='Quality of service reliability setting',
    )
    parser.add_argument(
        '--qos-durability',
        choices=DurabilityPolicy.short_keys(),
        help='Quality of service durability setting',
    )


def topic_type(node: Node, topic: str, given: str | None) -> Any:
    """Message class of a topic, from the graph where the command line does not say.

    Raises:
        Refusal: nobody publishes it, or in more than one type.
    """
    if given is not None:
        return interface(given, 'msg')
    known = dict(node.get_topic_names_and_types())
    types = known.get(topic, [])
    if not types:
        raise Refusal(
            f'WARNING: topic [{topic}] does not appear to be published yet\n'
            f'Could not determine the type for the passed topic{nearest(topic, known)}'
        )
    if len(types) > 1:
        raise Refusal(
            f"Cannot echo topic '{topic}', as it contains more than one type: [{', '.join(types)}]"
        )
    return interface(types[0], 'msg')


def chosen_qos(node: Node, topic: str, args: argparse.Namespace) -> QoSProfile:
    """The preset with what the command line overrides, else with what all publishers offer."""
    qos = QoSPresetProfiles.get_from_short_key(args.qos_profile)
    overrides = (args.qos_depth, args.qos_reliability, args.qos_durability)
    if any(override is not None for override in overrides):
        override_qos(qos, args)
        return qos
    offers = [info.qos_profile for info in node.get_publishers_info_by_topic(topic)]
    if offers:
        qos.reliability = common(
            [offer.reliability for offer in offers],
            ReliabilityPolicy.RELIABLE,
            ReliabilityPolicy.BEST_EFFORT,
        )
        qos.durability = common(
            [offer.durability for offer in offers],
            DurabilityPolicy.TRANSIENT_LOCAL,
            DurabilityPolicy.VOLATILE,
        )
    return qos


def override_qos(qos: QoSProfile, args: argparse.Namespace) -> None:
    if args.qos_depth is not None:
        qos.depth = args.qos_depth
    if args.qos_reliability is not None:
        qos.reliability = ReliabilityPolicy.get_from_short_key(args.qos_reliability)
    if args.qos_durability is not None:
        qos.durability = DurabilityPolicy.get_from_short_key(args.qos_durability)


def common(offered: list[Any], strong: Any, weak: Any) -> Any:
    """The strong policy where every publisher offers it, else the one that connects to all."""
    if all(policy == strong for policy in offered):
        return strong
    if strong in offered:
        kind = type(strong).__name__.replace('Policy', '').lower()
        print(
            f'Some, but not all, publishers are offering {kind} {strong.name}. Falling back to '
            f'{weak.name} as it will connect to all publishers'
        )
    return weak
